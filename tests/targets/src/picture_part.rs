//! Files of parts of pictures: good ones, changed ones, forged ones, too many and too few.

use crate::source::Source;
use splitplane_cli::merge::{merged, part_of};
use splitplane_core::tree::digest::Xxh64;

/// What may be asked for besides light, as the description has it.
const WANTED: [&str; 4] = [
    r#"{"aov":[],"heatmap":null,"heatmap_top":null}"#,
    r#"{"aov":["depth","tests"],"heatmap":null,"heatmap_top":null}"#,
    r#"{"aov":["normal","normal"],"heatmap":null,"heatmap_top":3}"#,
    r#"{"aov":[],"heatmap":"nodes","heatmap_top":null}"#,
];
/// Bytes before the description, and behind the pixels.
const HEAD: usize = 16;
const TAIL: usize = 8;

/// Bytes as choices of parts and of what is wrong with them.
pub fn run(data: &[u8]) {
    let mut source = Source::new(data);
    let (width, height) = (1 + source.below(5) as u32, 1 + source.below(5) as u32);
    let count = 1 + source.below(4) as u32;
    let wanted = source.pick(&WANTED);
    let pixels: Vec<u32> = (0..width * height).map(|_| source.bits() | 0xff00_0000).collect();
    let mut parts: Vec<Vec<u8>> = (1..=count)
        .map(|index| part_of((index, count), (width, height), wanted, &pixels).expect("a part"))
        .collect();
    let mut all = parts.clone();
    for _ in 0..source.below(4) {
        let at = source.below(parts.len());
        match source.below(5) {
            0 => parts.rotate_left(at),
            1 if parts.len() > 1 => drop(parts.remove(at)),
            2 => parts.push(parts[at].clone()),
            3 => drop(crate::change(&mut source, &mut parts[at])),
            _ => {
                forge(&mut source, &mut parts[at]);
                // What was forged may be as good as it was.
                return read(&parts, None);
            }
        }
    }
    // The order is no matter, and what was given twice may have been taken away again.
    let mut sorted = parts.clone();
    sorted.sort();
    all.sort();
    let is_light = !wanted.contains("nodes");
    read(&parts, Some((sorted == all, if is_light { &pixels } else { &[] })));
}

/// Puts parts together; `expected` says whether they are good, and the colours.
fn read(parts: &[Vec<u8>], expected: Option<(bool, &[u32])>) {
    let files: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
    let found = merged(&files);
    if let Err(failure) = &found {
        let text = failure.message();
        crate::check_message(text, if text.contains("missing") { "part" } else { ".picpart" });
    }
    match (expected, found) {
        (Some((true, pixels)), Ok(found)) => assert_eq!(found, pixels),
        (Some((true, _)), Err(failure)) => panic!("good parts: {}", failure.message()),
        (Some((false, _)), Ok(_)) => panic!("{} bad parts are merged", parts.len()),
        _ => {}
    }
}

/// Changes the description, and makes its length and the checksum fit.
fn forge(source: &mut Source<'_>, bytes: &mut Vec<u8>) {
    let Some(length) = bytes.get(12..HEAD).and_then(|word| word.first_chunk()) else { return };
    let end = HEAD + u32::from_le_bytes(*length) as usize;
    if bytes.len() < end + TAIL {
        return;
    }
    let mut text = bytes[HEAD..end].to_vec();
    for _ in 0..1 + source.below(3) {
        let digits: Vec<usize> = (0..text.len()).filter(|at| text[*at].is_ascii_digit()).collect();
        let number = source.pick(&["0", "1", "2", "7", "65537", "4294967295", "-1", "1e9", "\"\""]);
        match digits.get(source.below(digits.len().max(1))) {
            Some(&at) if source.below(4) < 3 => drop(text.splice(at..at + 1, number.bytes())),
            _ => drop(crate::change(source, &mut text)),
        }
    }
    let mut forged = bytes[..12].to_vec();
    forged.extend((text.len() as u32).to_le_bytes());
    forged.extend(text);
    forged.extend(&bytes[end..bytes.len() - TAIL]);
    let mut sum = Xxh64::new(1);
    sum.write(&forged);
    forged.extend(sum.finish().to_le_bytes());
    *bytes = forged;
}
