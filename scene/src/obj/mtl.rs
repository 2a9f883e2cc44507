//! Parses .mtl files; their interpretation is elsewhere.

use super::lines::Lines;
use crate::from_file::{quoted, quoted_word};

/// A material of an .mtl file.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Entry {
    pub(super) name: String,
    pub(super) diffuse: Option<[f32; 3]>,
    pub(super) specular: Option<[f32; 3]>,
    pub(super) emission: Option<[f32; 3]>,
    pub(super) filter: Option<[f32; 3]>,
    pub(super) refractive_index: Option<f32>,
    /// `d`: 1 is opaque.
    pub(super) dissolve: Option<f32>,
    /// `Tr`: 0 is opaque.
    pub(super) transparency: Option<f32>,
    /// `Pr`.
    pub(super) roughness: Option<f32>,
    /// `Ns`.
    pub(super) exponent: Option<f32>,
    pub(super) illum: Option<i64>,
    /// The picture of `map_Kd`, as written.
    pub(super) map: Option<String>,
    /// The picture of `map_d`, as written.
    pub(super) cutout: Option<String>,
}

/// Most notes on single materials of a file.
const MOST_NOTES: usize = 16;

/// Returns the materials of a text one at a time, and what was left out, a sentence each. Nothing
/// is kept of a line, since a file may have millions of them.
pub(super) fn parse(text: &str, mut found: impl FnMut(Entry)) -> Vec<String> {
    let mut current: Option<Entry> = None;
    let mut bad: (u64, Option<(u64, String)>) = (0, None);
    let mut warnings = Vec::new();
    let mut more = 0;
    for (number, content) in Lines::new(text) {
        let (keyword, rest) = match content.split_once(|c: char| c.is_ascii_whitespace()) {
            Some((keyword, rest)) => (keyword, rest.trim_ascii()),
            None => (&*content, ""),
        };
        if keyword == "newmtl" {
            let next = Entry { name: rest.to_owned(), ..Entry::default() };
            current.replace(next).into_iter().for_each(&mut found);
            continue;
        }
        // Before the first material there is nothing to describe.
        let Some(entry) = &mut current else { continue };
        let result = match keyword {
            "Kd" => colour(rest).map(|value| entry.diffuse = Some(value)),
            "Ks" => colour(rest).map(|value| entry.specular = Some(value)),
            "Ke" => colour(rest).map(|value| entry.emission = Some(value)),
            "Tf" => colour(rest).map(|value| entry.filter = Some(value)),
            "Ni" => last_number(rest).map(|value| entry.refractive_index = Some(value)),
            "d" => last_number(rest).map(|value| entry.dissolve = Some(value)),
            "Tr" => last_number(rest).map(|value| entry.transparency = Some(value)),
            "Pr" => last_number(rest).map(|value| entry.roughness = Some(value)),
            "Ns" => last_number(rest).map(|value| entry.exponent = Some(value)),
            "illum" => match rest.parse() {
                Ok(value) => {
                    entry.illum = Some(value);
                    Ok(())
                }
                Err(_) => {
                    let rest = quoted_word(rest);
                    Err(format!("`{rest}` is not a number of an illumination model"))
                }
            },
            // Exporters differ in the letters.
            _ if keyword.eq_ignore_ascii_case("map_Kd") => {
                let (name, ignored) = map(rest);
                if !ignored.is_empty() && warnings.len() < MOST_NOTES {
                    let (options, name) = (quoted(&ignored.join(" ")), quoted(&entry.name));
                    warnings.push(format!(
                        "the texture of material `{name}` is used without its options {options}"
                    ));
                } else if !ignored.is_empty() {
                    more += 1;
                }
                entry.map = name;
                if entry.map.is_some() { Ok(()) } else { Err("it names no file".to_owned()) }
            }
            _ if keyword.eq_ignore_ascii_case("map_d") => {
                entry.cutout = map(rest).0;
                if entry.cutout.is_some() { Ok(()) } else { Err("it names no file".to_owned()) }
            }
            _ => Ok(()),
        };
        if let Err(why) = result {
            bad.0 += 1;
            bad.1.get_or_insert((number, why));
        }
    }
    current.into_iter().for_each(&mut found);
    if more > 0 {
        warnings.push(format!("{more} more textures are used without their options"));
    }
    if let (count, Some((line, why))) = bad {
        warnings.insert(0, format!("{count} lines left out, the first is line {line}: {why}"));
    }
    warnings
}

/// One to three numbers; a single one is for all channels.
fn colour(text: &str) -> Result<[f32; 3], String> {
    let mut parts = [0.0; 3];
    let mut words = text.split_ascii_whitespace();
    let mut last = None;
    for part in &mut parts {
        last = match words.next() {
            Some(word) => Some(number(word)?),
            None => last,
        };
        *part = last.ok_or("a colour needs one or three numbers")?;
    }
    Ok(parts)
}

/// The number at the end of a line, after options such as `-halo`.
fn last_number(text: &str) -> Result<f32, String> {
    number(text.split_ascii_whitespace().next_back().unwrap_or(""))
}

fn number(word: &str) -> Result<f32, String> {
    match word.parse::<f32>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("`{}` is not a finite number", quoted_word(word))),
    }
}

/// The file that a map names, blanks and all, and the options that would change where or how bright
/// the picture is.
fn map(text: &str) -> (Option<String>, Vec<String>) {
    let mut rest = text.trim_ascii();
    let mut ignored = Vec::new();
    while let Some((option, after)) = option(rest) {
        let (arguments, after) = arguments(option, after);
        let changes = match option {
            "-o" | "-t" => arguments.iter().any(|word| word.parse() != Ok(0.0f32)),
            "-s" => arguments.iter().any(|word| word.parse() != Ok(1.0f32)),
            "-mm" => arguments != ["0", "1"],
            "-clamp" => arguments == ["on"],
            _ => false,
        };
        if changes {
            ignored.push(format!("{option} {}", arguments.join(" ")));
        }
        rest = after;
    }
    let name = rest.strip_prefix('"').and_then(|name| name.strip_suffix('"')).unwrap_or(rest);
    ((!name.is_empty()).then(|| name.to_owned()), ignored)
}

/// The first word, if it is an option; the name of a file may begin with a hyphen too.
fn option(text: &str) -> Option<(&str, &str)> {
    let (word, rest) = first_word(text);
    let known = [
        "-blendu", "-blendv", "-bm", "-boost", "-cc", "-clamp", "-imfchan", "-mm", "-o", "-s",
        "-t", "-texres", "-type",
    ];
    known.contains(&word).then_some((word, rest))
}

/// What follows an option: one word, or up to three numbers.
fn arguments<'a>(option: &str, text: &'a str) -> (Vec<&'a str>, &'a str) {
    let most = match option {
        "-o" | "-s" | "-t" => 3,
        "-mm" => 2,
        _ => 1,
    };
    let mut words = Vec::new();
    let mut rest = text;
    while words.len() < most {
        let (word, after) = first_word(rest);
        let fits = most == 1 || word.parse::<f32>().is_ok();
        // The last word is the file's name.
        if !fits || after.is_empty() {
            break;
        }
        words.push(word);
        rest = after;
    }
    (words, rest)
}

fn first_word(text: &str) -> (&str, &str) {
    match text.split_once(|c: char| c.is_ascii_whitespace()) {
        Some((word, rest)) => (word, rest.trim_ascii_start()),
        None => (text, ""),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> (Vec<Entry>, Vec<String>) {
        let mut entries = Vec::new();
        let warnings = super::parse(text, |entry| entries.push(entry));
        (entries, warnings)
    }

    #[test]
    fn notes_of_a_file_are_few() {
        let text = format!("newmtl a\n{}", "d\nmap_Kd -s 2 2 a\n".repeat(1000));
        let (_, warnings) = parse(&text);
        assert_eq!(warnings.len(), 2 + MOST_NOTES);
        assert!(warnings[0].starts_with("1000 lines left out, the first is line 2: "));
        let last = format!("{} more textures are used without their options", 1000 - MOST_NOTES);
        assert_eq!(warnings.last(), Some(&last));
    }

    #[test]
    fn every_keyword_is_kept() {
        let text = "Kd 9 9 9\nnewmtl a b\nKd .1 .2 .3\nKs 0.5\nKe 125 100 75\nTf 1 .5 0\nNi 1.5\n\
                    d -halo 0.25\nTr 0.75\nillum 7\nmap_kd  a b.png\nMap_D -imfchan m leaf.png\nNs 10\nPr 0.5\nmap_Bump x.png\nnewmtl c";
        let (entries, warnings) = parse(text);
        assert_eq!(warnings, [""; 0]);
        let want = Entry {
            name: "a b".into(),
            diffuse: Some([0.1, 0.2, 0.3]),
            specular: Some([0.5; 3]),
            emission: Some([125.0, 100.0, 75.0]),
            filter: Some([1.0, 0.5, 0.0]),
            refractive_index: Some(1.5),
            dissolve: Some(0.25),
            transparency: Some(0.75),
            roughness: Some(0.5),
            exponent: Some(10.0),
            illum: Some(7),
            map: Some("a b.png".into()),
            cutout: Some("leaf.png".into()),
        };
        assert_eq!(entries, [want, Entry { name: "c".into(), ..Entry::default() }]);
    }

    #[test]
    fn bad_lines_are_left_out_and_counted() {
        let bad =
            ["Kd", "Kd x y z", "Ks 1 nan 1", "Kd spectral a.rfl", "d", "Ni 1e99", "illum 2.5"];
        for line in bad {
            let (entries, warnings) =
                parse(&format!("newmtl a\n{line}\nKe 1 1 1\nmap_Kd -s 1 1 1\n"));
            assert_eq!(entries[0].emission, Some([1.0; 3]), "{line}");
            let counted = warnings[0].starts_with("1 lines left out, the first is line 2: ");
            assert!(counted, "{line}: {warnings:?}");
        }
        let (_, warnings) = parse("newmtl a\nmap_Kd\nKd x");
        assert_eq!(warnings, ["2 lines left out, the first is line 2: it names no file"]);
    }

    #[test]
    fn options_of_maps_are_read_over() {
        let name = |text| map(text).0.unwrap();
        assert_eq!(name("-blendu on -clamp off wood.png"), "wood.png");
        assert_eq!(name("-o 0 0 -s 1 1 1 -mm 0 1 my wood  floor.png"), "my wood  floor.png");
        assert_eq!(name("-s 2 2 1.png"), "1.png");
        assert_eq!(name("-s 2 2 2 7"), "7");
        assert_eq!(name("-odd.png"), "-odd.png");
        assert_eq!(name("\"a b.png\""), "a b.png");
        assert_eq!(map("").0, None);
        let ignored = |text| map(text).1;
        assert_eq!(ignored("-o 0 0 0 -s 1 1 a.png -texres 9"), [""; 0]);
        assert_eq!(ignored("-s 2 2 -clamp on -o 0.5 a.png"), ["-s 2 2", "-clamp on", "-o 0.5"]);
    }
}
