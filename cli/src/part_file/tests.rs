use super::*;
use splitplane_test_support::random::Random;

fn wanted(text: &str) -> Wanted {
    serde_json::from_str(text).unwrap()
}

const ALL: &str = r#"{"aov":["depth","tests"],"heatmap":null,"heatmap_top":null}"#;
const LIGHT: &str = r#"{"aov":[],"heatmap":null,"heatmap_top":null}"#;
const HEAT: &str = r#"{"aov":[],"heatmap":"nodes","heatmap_top":7}"#;

fn settings() -> Settings {
    [("samples", "4"), ("tree", "0123456789abcdef")]
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
        .into()
}

/// What a tracer could have made: any bits.
struct Frame {
    size: Size,
    hits: Vec<FirstHit>,
    costs: Vec<FirstCost>,
    radiance: Vec<[f32; 4]>,
    pixels: Vec<u32>,
}

impl Frame {
    fn new(width: u32, height: u32) -> Frame {
        let (mut random, size) = (Random::new(5), Size::new(width, height).unwrap());
        let pixels = size.pixels();
        let mut word = || random.bits();
        let mut float = || f32::from_bits(word() & 0x7f7f_ffff);
        let hits = (0..pixels).map(|i| FirstHit {
            normal: [float(), float(), float()],
            depth: f32::INFINITY,
            triangle: u32::MAX - i,
            u: -0.0,
            v: float(),
            instance: i,
        });
        Frame {
            size,
            hits: hits.collect(),
            costs: (0..pixels).map(|i| FirstCost { nodes: i, triangles: !i }).collect(),
            radiance: (0..pixels).map(|_| [float(), float(), float(), 0.0]).collect(),
            pixels: (0..pixels).map(|i| i.wrapping_mul(0x9e37_79b9) | 0xff00_0000).collect(),
        }
    }

    /// With what was not asked for empty, as frames have it.
    fn made(&self, wanted: &Wanted) -> Made<'_> {
        fn when<T>(needed: bool, all: &[T]) -> &[T] {
            if needed { all } else { &[] }
        }
        let outputs = wanted.outputs(true, true);
        Made {
            size: self.size,
            hits: when(outputs.first_hits, &self.hits),
            costs: when(outputs.first_costs, &self.costs),
            radiance: when(outputs.radiance, &self.radiance),
            pixels: when(outputs.pixels, &self.pixels),
        }
    }
}

fn file(index: u32, count: u32, wanted: &Wanted, frame: &Frame) -> Vec<u8> {
    let part = Part::new(index, count).unwrap();
    to_bytes(part, wanted, &settings(), &frame.made(wanted)).unwrap()
}

/// The checksum made to fit again: a file that somebody made.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let end = bytes.len() - TAIL;
    let sum = checksum(&bytes[..end]);
    bytes[end..].copy_from_slice(&sum.to_le_bytes());
    bytes
}

#[test]
fn parts_come_back_bit_for_bit() {
    let frame = Frame::new(7, 5);
    for text in [ALL, LIGHT, HEAT] {
        let wanted = wanted(text);
        for count in [1, 2, 4, 40] {
            for index in 1..=count {
                let read = parse(&file(index, count, &wanted, &frame)).unwrap();
                assert_eq!(read.part, Part::new(index, count).unwrap());
                assert_eq!((read.size, &read.wanted), (frame.size, &wanted));
                assert_eq!(read.settings, settings());
                let own = read.part.share(frame.size.pixels());
                let own = own.start as usize..own.end as usize;
                let made = frame.made(&wanted);
                let of = |length: usize| if length == 0 { 0..0 } else { own.clone() };
                assert_eq!(read.radiance, made.radiance[of(made.radiance.len())]);
                assert_eq!(read.pixels, made.pixels[of(made.pixels.len())]);
                assert_eq!(read.hits, made.hits[of(made.hits.len())]);
                assert_eq!(read.costs, made.costs[of(made.costs.len())]);
            }
        }
    }
}

/// Every file that is cut off, and every one with a byte changed, is refused.
#[test]
fn damage_is_found() {
    let (frame, wanted) = (Frame::new(3, 2), wanted(ALL));
    let whole = file(2, 3, &wanted, &frame);
    for cut in 0..whole.len() {
        let error = parse(&whole[..cut]).unwrap_err();
        let expected = match cut {
            0..HEAD => PartFileError::Head { found: cut, needed: HEAD },
            _ => match &error {
                PartFileError::Head { found, needed } if *found == cut && *needed > cut => continue,
                _ => PartFileError::Length { promised: whole.len() as u64, found: cut as u64 },
            },
        };
        assert_eq!(error, expected, "{cut}");
    }
    let mut long = whole.clone();
    long.push(0);
    assert!(matches!(parse(&long), Err(PartFileError::Length { .. })));
    for at in 0..whole.len() {
        for bit in [1, 0x80] {
            let mut bytes = whole.clone();
            bytes[at] ^= bit;
            assert!(parse(&bytes).is_err(), "{at}");
        }
    }
}

/// What is forged has a checksum that fits.
#[test]
fn forged_descriptions_are_typed_errors() {
    let (frame, wanted) = (Frame::new(3, 2), wanted(LIGHT));
    let whole = file(1, 2, &wanted, &frame);
    let with = |at: usize, bytes: &[u8]| {
        let mut forged = whole.clone();
        forged[at..at + bytes.len()].copy_from_slice(bytes);
        parse(&sealed(forged)).unwrap_err()
    };
    assert_eq!(with(0, b"PICTURE\0"), PartFileError::Magic);
    assert_eq!(with(8, &2u32.to_le_bytes()), PartFileError::Version(2));
    assert_eq!(with(12, &u32::MAX.to_le_bytes()), PartFileError::LongDescription(u32::MAX));
    assert!(matches!(with(12, &65536u32.to_le_bytes()), PartFileError::Head { .. }));
    let text = |old: &str, new: &str| {
        let length = u32::from_le_bytes(*whole[12..].first_chunk().unwrap()) as usize;
        let before = std::str::from_utf8(&whole[HEAD..HEAD + length]).unwrap();
        assert!(before.contains(old), "{before}");
        let after = before.replacen(old, new, 1);
        let mut forged = whole[..12].to_vec();
        forged.extend((after.len() as u32).to_le_bytes());
        forged.extend(after.bytes());
        forged.extend(&whole[HEAD + length..]);
        parse(&sealed(forged)).unwrap_err()
    };
    assert!(matches!(text("{", "["), PartFileError::Description(_)));
    assert!(matches!(text("\"width\"", "\"breadth\""), PartFileError::Description(_)));
    assert!(matches!(text(":2", ":-2"), PartFileError::Description(_)));
    assert!(matches!(text("\"aov\":[]", "\"aov\":[\"colour\"]"), PartFileError::Description(_)));
    let index = PartError::Index { index: 0, count: 2 };
    assert_eq!(text("\"index\":1", "\"index\":0"), PartFileError::Part(index));
    let count = PartError::Count { count: 99999 };
    assert_eq!(text("\"count\":2", "\"count\":99999"), PartFileError::Part(count));
    assert!(matches!(text("\"width\":3", "\"width\":0"), PartFileError::Size(_)));
    assert!(matches!(text("\"width\":3", "\"width\":4000000000"), PartFileError::Size(_)));
    // More than there is, and of what is there something else.
    let length = |promised, text: PartFileError| match text {
        PartFileError::Length { promised: found, .. } => {
            assert_eq!(found > 3_000_000_000, promised);
        }
        other => panic!("{other:?}"),
    };
    length(false, text("\"width\":3", "\"width\":30"));
    length(false, text("\"aov\":[]", "\"aov\":[\"depth\"]"));
    length(false, text("\"heatmap\":null", "\"heatmap\":\"nodes\""));
    let huge = text(
        "\"count\":2,\"width\":3,\"height\":2,\"wanted\":{\"aov\":[]",
        "\"count\":1,\"width\":16384,\"height\":4096,\"wanted\":{\"aov\":[\"depth\"]",
    );
    length(true, huge);
}

/// The first difference is named, what one learns most of before what follows from it.
#[test]
fn differences_are_named() {
    let frame = Frame::new(3, 2);
    let read = |index, count, text, frame: &Frame| {
        parse(&file(index, count, &wanted(text), frame)).unwrap()
    };
    let first = read(1, 2, LIGHT, &frame);
    assert_eq!(first.difference(&read(2, 2, LIGHT, &frame)), None);
    let of = |other: &PartFile| first.difference(other).unwrap().join(", ");
    assert_eq!(of(&read(2, 2, LIGHT, &Frame::new(2, 3))), "size, 3x2, 2x3");
    assert_eq!(of(&read(2, 3, LIGHT, &frame)), "number of parts, 2, 3");
    assert!(of(&read(2, 2, ALL, &frame)).starts_with("outputs, {"));
    let mut other = read(2, 2, LIGHT, &frame);
    other.settings.insert("tree".into(), "0".into());
    assert_eq!(of(&other), "tree, 0123456789abcdef, 0");
    other.settings.insert("samples".into(), "16".into());
    assert_eq!(of(&other), "samples, 4, 16");
    other.settings.insert("a\u{1b}[2J".into(), "x".repeat(1000));
    assert!(of(&other).starts_with("a\\u{1b}[2J, not said, xxx") && of(&other).len() < 300);
}
