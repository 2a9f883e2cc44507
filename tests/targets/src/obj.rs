//! OBJ text, with the .mtl files and pictures it names.
//!
//! The text is made from a grammar together with what it means, and read back; or its bytes are
//! changed after that, and only what must hold of any text is checked.

use crate::folder;
use crate::source::Source;
use splitplane::scene::obj::{self, ObjError, ObjProblem};
use splitplane::scene::{MaterialRule, Scene, SceneOptions};

/// What reads text of a name.
pub type Reader = fn(&str, &str) -> Result<Scene, ObjError>;

/// Bytes as OBJ text.
pub fn run(data: &[u8]) {
    run_on(data, obj::parse);
}

/// The same for any reader of text, such as one with a fault.
pub fn run_on(data: &[u8], parse: Reader) {
    let mut source = Source::new(data);
    match source.below(32) {
        0..4 => any_text(source.rest(), parse),
        4..20 => meant(&mut source, parse),
        20..30 => altered(&mut source, parse),
        // Files take a hundred times as long.
        _ => with_files(&mut source),
    }
}

fn any_text(bytes: &[u8], parse: Reader) {
    if let Ok(text) = std::str::from_utf8(bytes) {
        check(&parse(text, "any.obj"), text);
    } else {
        let path = folder::write("any.obj", bytes);
        let read = obj::read(&path);
        let not_text = |error: &ObjError| error.problem == ObjProblem::NotUtf8;
        assert!(read.as_ref().is_err_and(not_text), "{read:?}");
        check(&read, &String::from_utf8_lossy(bytes));
    }
}

/// What a text says: positions and triangles, or the line where it goes wrong.
#[derive(Default)]
struct Meaning {
    counts: [usize; 3],
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    /// The first line that is wrong by itself.
    wrong: Option<u64>,
    /// For each kind, the index beyond which every line so far stays, and lines that name more.
    ahead: Vec<(u64, usize, i64)>,
}

impl Meaning {
    /// The place that an index names; what is wrong with it is noted.
    fn place(&mut self, kind: usize, line: u64, index: i64) -> u32 {
        let count = self.counts[kind] as i64;
        if index > 0 {
            self.ahead.push((line, kind, index));
            return u32::try_from(index - 1).unwrap_or(u32::MAX);
        }
        if index == 0 || index.checked_add(count).is_none_or(|place| place < 0) {
            self.wrong.get_or_insert(line);
            return 0;
        }
        (index + count) as u32
    }

    /// The line where reading must fail; `Some(None)` when that is the file as a whole.
    fn error(&self) -> Option<Option<u64>> {
        if let Some(line) = self.wrong {
            return Some(Some(line));
        }
        let missing = |&&(_, kind, index): &&(u64, usize, i64)| index > self.counts[kind] as i64;
        match self.ahead.iter().filter(missing).map(|(line, ..)| *line).min() {
            Some(line) => Some(Some(line)),
            None => self.triangles.is_empty().then_some(None),
        }
    }
}

/// A number as text, and its value; `None` for what is none.
fn number(source: &mut Source<'_>) -> (String, Option<f32>) {
    let text = match source.below(8) {
        0..4 => format!("{}", source.step()),
        4 => source
            .pick(&[
                "nan",
                "NaN",
                "-inf",
                "infinity",
                "1e39",
                "-1e-60",
                "+.5",
                "5.",
                "1e-45",
                "00012",
                "3.402823669e38",
                "0.1e1",
                "-0",
            ])
            .to_owned(),
        5 => format!("{:e}", source.number()),
        6 => format!("{:?}", source.number()),
        _ => "9".repeat(1 + source.below(400)),
    };
    if source.once_in(64) {
        let bad = source.pick(&["x", "1_0", "0x10", "--1", "1e", ".", "1,5", "\u{661}", "1\u{0}"]);
        return (bad.to_owned(), None);
    }
    let value = text.parse().ok();
    (text, value)
}

/// An index as text, and its value.
fn index(source: &mut Source<'_>, count: usize) -> (String, Option<i64>) {
    let near = source.below(count + 1) as i64;
    let index = match source.below(32) {
        0..20 => near.max(1),
        20..30 => -near.max(1),
        30 => source.pick(&[
            0,
            -1,
            1,
            i64::MAX,
            i64::MIN,
            1 << 32,
            (1 << 32) - 1,
            -(1 << 32),
            1 << 31,
            4_294_967_297,
        ]),
        _ => source.below(2 * count + 3) as i64 - count as i64,
    };
    let text = match source.below(128) {
        0..100 => index.to_string(),
        100..127 if index >= 0 => format!("+{index}"),
        127 => {
            let bad = source.pick(&["", "x", "1.0", "99999999999999999999", "- 1"]);
            // A blank makes two words of it, and an empty one none: no corners of this kind.
            return (bad.replace(' ', "_"), None);
        }
        _ => index.to_string(),
    };
    (text, Some(index))
}

/// Text from the grammar, and what it means.
fn grammar(source: &mut Source<'_>) -> (String, Meaning) {
    let ending = source.pick(&["\n", "\r\n", "\r"]);
    let mut text = String::from(source.pick(&["", "\u{feff}"]));
    let mut meaning = Meaning::default();
    let mut line = 1;
    let statements = 1 + source.below(40);
    for _ in 0..statements {
        if source.is_empty() {
            break;
        }
        let words = statement(source, &mut meaning, line);
        text += source.pick(&["", "", "", " ", "\t", "  \t"]);
        let blank = source.pick(&[" ", " ", " ", "\t", "   "]);
        for (i, word) in words.iter().enumerate() {
            if i > 0 {
                // Carriage returns end no line where they are not the line ends.
                if source.once_in(32) && ending != "\r" {
                    text += " \\";
                    text += ending;
                    line += 1;
                } else {
                    text += blank;
                }
            }
            text += word;
        }
        if source.once_in(16) {
            text += source.pick(&[" # a comment \\ of sorts", "#", "# v 1 2 3"]);
        }
        text += ending;
        line += 1;
    }
    // Without a line feed or a carriage return it is one line, whatever the ending.
    (text, meaning)
}

/// The words of one statement.
fn statement(source: &mut Source<'_>, meaning: &mut Meaning, line: u64) -> Vec<String> {
    match source.below(16) {
        0..6 => element(source, meaning, line, 0),
        6 => element(source, meaning, line, 1),
        7 => element(source, meaning, line, 2),
        8..14 => face(source, meaning, line),
        14 => {
            let words = source.pick(&[
                &["usemtl", "a"][..],
                &["usemtl", "b", "c"],
                &["usemtl"],
                &["g", "group"],
                &["o"],
                &["s", "off"],
                &["p", "1"],
                &["l", "1", "2"],
                &["curv", "0", "1"],
                &["vp", "x"],
                &["mtllib"],
                &["mtllib", "no.mtl"],
                &["call", "x.obj"],
                &["\u{fffd}\u{202e}"],
            ]);
            words.iter().map(|word| (*word).to_owned()).collect()
        }
        _ => Vec::new(),
    }
}

/// `v`, `vt` or `vn`.
fn element(source: &mut Source<'_>, meaning: &mut Meaning, line: u64, kind: usize) -> Vec<String> {
    let least = [3, 1, 3][kind];
    let mut words = vec![["v", "vt", "vn"][kind].to_owned()];
    let count = match source.below(32) {
        0..28 => 3,
        28 => source.below(3),
        _ => 3 + source.below(5),
    };
    let mut values = Vec::new();
    for _ in 0..count {
        let (text, value) = number(source);
        words.push(text);
        values.push(value);
    }
    if meaning.wrong.is_some() {
        return words;
    }
    if count < least || values.contains(&None) {
        meaning.wrong = Some(line);
        return words;
    }
    meaning.counts[kind] += 1;
    if kind == 0 {
        meaning.positions.push([0, 1, 2].map(|i| values[i].unwrap_or(0.0)));
    }
    words
}

fn face(source: &mut Source<'_>, meaning: &mut Meaning, line: u64) -> Vec<String> {
    let mut words = vec![source.pick(&["f", "f", "fo"]).to_owned()];
    let count = match source.below(16) {
        0..12 => 3,
        12 => source.below(3),
        13 => 40,
        _ => 3 + source.below(4),
    };
    let shape = source.below(5);
    let mut corners = Vec::new();
    for _ in 0..count {
        let mut word = String::new();
        let mut places = [None; 3];
        // `v`, `v/vt`, `v/vt/vn`, `v//vn`, `v/`.
        let kinds: &[usize] = [&[0][..], &[0, 1], &[0, 1, 2], &[0, 2], &[0]][shape];
        let mut bad = false;
        for &kind in kinds {
            let (text, index) = index(source, meaning.counts[kind]);
            // What follows an empty part that is no index is one without.
            bad |= index.is_none() && !(text.is_empty() && kind > 0);
            places[kind] = index;
            word += ["", "/", if shape == 3 { "//" } else { "/" }][kind];
            word += &text;
        }
        if shape == 4 {
            word += "/";
        }
        if word.is_empty() {
            continue;
        }
        words.push(word);
        if meaning.wrong.is_some() {
            continue;
        }
        if bad {
            // Which part is looked at first is the reader's affair; the line is the same.
            meaning.wrong = Some(line);
            continue;
        }
        let position = places[0].map(|index| meaning.place(0, line, index));
        for kind in [1, 2] {
            if let Some(index) = places[kind] {
                meaning.place(kind, line, index);
            }
        }
        corners.extend(position);
    }
    if meaning.wrong.is_none() && corners.len() >= 3 {
        for pair in corners[1..].windows(2) {
            meaning.triangles.push([corners[0], pair[0], pair[1]]);
        }
    }
    words
}

/// Text must be read as it is meant.
fn meant(source: &mut Source<'_>, parse: Reader) {
    let (text, meaning) = grammar(source);
    let read = parse(&text, "any.obj");
    check(&read, &text);
    match (&read, meaning.error()) {
        (Ok(scene), None) => {
            let bits = |positions: &[[f32; 3]]| -> Vec<[u32; 3]> {
                positions.iter().map(|position| position.map(same_nan)).collect()
            };
            assert_eq!(bits(&scene.positions), bits(&meaning.positions), "{text}");
            assert_eq!(scene.indices, meaning.triangles, "{text}");
        }
        (Err(error), Some(line)) => assert_eq!(error.line, line, "{error}\n{text}"),
        (Ok(_), Some(line)) => panic!("read, though wrong in line {line:?}:\n{text}"),
        (Err(error), None) => panic!("refused: {error}\n{text}"),
    }
}

fn same_nan(x: f32) -> u32 {
    if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() }
}

/// Text with changes that make it mean anything or nothing.
fn altered(source: &mut Source<'_>, parse: Reader) {
    let (text, _) = grammar(source);
    let mut bytes = text.into_bytes();
    for _ in 0..1 + source.below(6) {
        alter(source, &mut bytes);
    }
    any_text(&bytes, parse);
}

fn alter(source: &mut Source<'_>, bytes: &mut Vec<u8>) {
    if bytes.is_empty() {
        return;
    }
    let at = source.below(bytes.len());
    match source.below(8) {
        0 => bytes[at] = source.below(256) as u8,
        1 => bytes[at] = source.pick(b"\n\r\\#/ -0v"),
        2 => bytes.insert(at, source.pick(b"\n\r\\#/ -\0\x0b\x0cf")),
        3 => drop(bytes.remove(at)),
        4 => bytes.truncate(at),
        5 => drop(bytes.splice(at..at, "\u{a0}\u{2028}\u{85}\u{130}".bytes())),
        6 => drop(
            bytes
                .splice(at..at, std::iter::repeat_n(source.pick(b"0/ 1-"), 1 + source.below(3000))),
        ),
        _ => {
            // A part twice.
            let end = (at + 1 + source.below(60)).min(bytes.len());
            let part = bytes[at..end].to_vec();
            bytes.splice(at..at, part);
        }
    }
}

/// What must hold of any scene and of any error.
fn check(read: &Result<Scene, ObjError>, text: &str) {
    let scene = match read {
        Ok(scene) => scene,
        Err(error) => {
            let message = error.to_string();
            crate::check_message(&message, "any.obj");
            let lines = text.split(['\n', '\r']).count() as u64;
            match error.line {
                Some(line) => {
                    assert!((1..=lines).contains(&line), "line {line} of {lines}: {message}");
                    assert!(message.contains(&format!("line {line}: ")), "{message}");
                }
                None => assert_eq!(error.problem, ObjProblem::NoTriangles),
            }
            assert!(!message.chars().any(char::is_control), "{message:?}");
            return;
        }
    };
    let mesh = scene.mesh().expect("indices in range");
    assert_eq!(scene.material_of.len(), mesh.len());
    assert!(scene.material_of.iter().all(|&of| (of as usize) < scene.materials.len()));
    for (indices, count) in [
        (&scene.normal_indices, scene.normals.len()),
        (&scene.texcoord_indices, scene.texcoords.len()),
    ] {
        assert!(indices.is_empty() || indices.len() == mesh.len());
        let fits = |&corner: &u32| corner == Scene::NONE || (corner as usize) < count;
        assert!(indices.as_flattened().iter().all(fits));
    }
    for material in &scene.materials {
        assert!(material.texture.is_none_or(|texture| (texture as usize) < scene.textures.len()));
        assert!(material.diffuse.iter().chain(&material.emission).all(|x| x.is_finite()));
    }
    for sentence in scene.notes.sentences() {
        crate::check_message(&sentence, "");
        assert!(!sentence.chars().any(char::is_control), "{sentence:?}");
    }
}

/// A file beside .mtl files and pictures that are there, are not, or are broken.
fn with_files(source: &mut Source<'_>) {
    let names = ["a.mtl", "b c.mtl"];
    for name in names {
        if source.once_in(3) {
            folder::remove(&folder::path(name));
        } else {
            folder::write(name, &materials(source));
        }
    }
    let picture = source.pick(&["p.png", "p.jpg", "p.bmp", "p.tga"]);
    folder::write(picture, &picture_bytes(source));
    let library = source.pick(&[
        "a.mtl",
        "b c.mtl",
        "a.mtl b c.mtl",
        "b c.mtl a.mtl a.mtl",
        "no.mtl",
        "",
        "/",
        "..",
        "p.png",
    ]);
    let mut text = format!(
        "mtllib {library}\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl b c\nf 3 2 1\n"
    );
    text += &grammar(source).0;
    let path = folder::write("any.obj", text.as_bytes());
    let options = SceneOptions {
        materials: source.pick(&[MaterialRule::Illum, MaterialRule::Specular]),
        textures: !source.once_in(8),
        texture_limit: source.pick(&[1 << 20, 0, 1, 100, u64::MAX]),
        decode_limit: source.pick(&[1 << 20, 0, 1, 100, 1 << 24]),
        ..SceneOptions::default()
    };
    check(&obj::read_with(&path, &options), &text);
    folder::remove(&folder::path(picture));
}

/// The text of an .mtl file.
fn materials(source: &mut Source<'_>) -> Vec<u8> {
    let mut text = String::new();
    for _ in 0..source.below(14) {
        let keyword = source.pick(&[
            "newmtl", "newmtl", "Kd", "Ks", "Ke", "Tf", "Ni", "d", "Tr", "illum", "map_Kd",
            "map_kd", "Ns", "#", "",
        ]);
        text += keyword;
        match keyword {
            "newmtl" => text += source.pick(&[" a", " b c", "", " d"]),
            "map_Kd" | "map_kd" => {
                text +=
                    source.pick(&["", " -s 2 2", " -o 0", " -clamp on", " -mm 0 1", " -bm", " -x"]);
                text += source.pick(&[
                    " p.png",
                    " p.jpg",
                    " p.bmp",
                    " p.tga",
                    "",
                    " C:\\x\\p.png",
                    " \"p.png\"",
                    " ..",
                    " /",
                    " a.mtl",
                ]);
            }
            _ => {
                for _ in 0..source.below(5) {
                    text += " ";
                    text += &number(source).0;
                }
            }
        }
        text += source.pick(&["\n", "\r\n", " \\\n", "\n\n"]);
    }
    let mut bytes = text.into_bytes();
    if source.once_in(4) {
        alter(source, &mut bytes);
    }
    bytes
}

/// A picture of 2 by 2 texels, perhaps broken, or any bytes.
fn picture_bytes(source: &mut Source<'_>) -> Vec<u8> {
    // 32 bits a texel, uncompressed: TGA, whose head has no mark and is easily made wrong.
    let mut bytes = vec![0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, 32, 8];
    bytes.extend([0x40; 16]);
    match source.below(3) {
        0 => {}
        1 => {
            for _ in 0..1 + source.below(4) {
                let at = source.below(bytes.len());
                bytes[at] = source.below(256) as u8;
            }
        }
        _ => {
            bytes = source
                .pick(&[&b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR"[..], b"\xff\xd8\xff\xe0", b"BM", b""])
                .to_vec();
            bytes.extend(source.bytes(64));
        }
    }
    bytes
}
