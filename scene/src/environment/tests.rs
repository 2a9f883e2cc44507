use super::*;
use image::ExtendedColorType::Rgb32F;
use image::ImageEncoder;
use image::codecs::openexr::OpenExrEncoder;

/// A Radiance picture of red, green, blue and exponent by texel, without compression.
fn radiance(head: &str, size: &str, texels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n{head}\n{size}\n").into_bytes();
    bytes.extend(texels.as_flattened());
    bytes
}

fn exr(width: u32, height: u32, texels: &[[f32; 3]]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let words = bytemuck::cast_slice(texels.as_flattened());
    OpenExrEncoder::new(&mut bytes).write_image(words, width, height, Rgb32F).unwrap();
    bytes.into_inner()
}

fn read(bytes: &[u8]) -> Result<ReadEnvironment, EnvironmentProblem> {
    parse(bytes, &EnvironmentOptions::default())
}

const TEXELS: [[u8; 4]; 4] = [[128, 64, 32, 129], [128, 128, 128, 130], [1, 2, 3, 128], [0; 4]];

/// Texels are (red, green, blue) times 2^(exponent - 136), in either format.
#[test]
fn both_formats_give_their_texels() {
    let map = |texels| EnvironmentMap::new(2, 2, texels).unwrap();
    let part = 1.0 / 256.0;
    let want = vec![[1.0, 0.5, 0.25], [2.0; 3], [part, 2.0 * part, 3.0 * part], [0.0; 3]];
    let found = read(&radiance("", "-Y 2 +X 2", &TEXELS)).unwrap();
    assert_eq!(found, ReadEnvironment { map: map(want.clone()), negative: 0 });
    assert_eq!(read(&exr(2, 2, &want)).unwrap().map, map(want.clone()));
    // What the head says of exposures is undone.
    let head = "EXPOSURE=2\nEXPOSURE= 0.25\nCOLORCORR=1 2 4\n";
    let brighter = want.iter().map(|[r, g, b]| [r * 2.0, *g, b * 0.5]).collect();
    assert_eq!(read(&radiance(head, "-Y 2 +X 2", &TEXELS)).unwrap().map, map(brighter));
    let options =
        EnvironmentOptions { strength: 3.0, rotation_degrees: -90.0, ..Default::default() };
    let found = parse(&exr(2, 2, &want), &options).unwrap().map;
    assert_eq!(found, map(want).with_strength(3.0).unwrap().with_rotation(-90.0).unwrap());
}

#[test]
fn negative_light_is_none_and_is_said() {
    let found = read(&exr(2, 1, &[[1.0, -0.5, 2.0], [3.0; 3]])).unwrap();
    assert_eq!(found.map, EnvironmentMap::new(2, 1, vec![[1.0, 0.0, 2.0], [3.0; 3]]).unwrap());
    let note = found.note(Path::new("a.exr")).unwrap();
    assert!(note.starts_with("1 texels of `a.exr` are negative"), "{note}");
    assert_eq!(read(&exr(1, 1, &[[1.0; 3]])).unwrap().note(Path::new("a.exr")), None);
}

#[test]
fn what_is_no_environment_is_a_typed_error() {
    use EnvironmentProblem::{Format, Map, Picture, TooLarge};
    assert_eq!(read(b""), Err(Format));
    assert_eq!(read(b"\x89PNG"), Err(Format));
    let of = |size| read(&radiance("", size, &TEXELS));
    assert!(matches!(of("+Y 2 +X 2"), Err(Picture(_))), "upside down");
    assert!(matches!(of("-Y 2 +X 3"), Err(Picture(_))), "cut short");
    assert!(matches!(of("-Y 0 +X 2"), Err(Map(EnvironmentMapError::Size { .. }) | Picture(_))));
    let large = of("-Y 60000 +X 60000");
    assert!(matches!(large, Err(TooLarge { width: 60_000, .. })), "{large:?}");
    assert!(large.unwrap_err().is_limit());
    assert!(matches!(of("-Y 4294967295 +X 4294967295"), Err(TooLarge { .. } | Picture(_))));
    let long = of("-Y 1 +X 20000");
    assert!(matches!(long, Err(Picture(_))), "{long:?}");
    for head in [
        "EXPOSURE=0\n",
        "EXPOSURE=-1\n",
        "COLORCORR=1 1 0\n",
        "EXPOSURE=x\n",
        "FORMAT=32-bit_rle_xyze\n",
    ] {
        let found = read(&radiance(head, "-Y 2 +X 2", &TEXELS));
        assert!(matches!(found, Err(Picture(_))), "{head}");
    }
    let place = |value| match read(&exr(2, 2, &[[0.0; 3], [0.0; 3], [0.0, value, 0.0], [0.0; 3]])) {
        Err(Map(error)) => error.to_string(),
        other => panic!("{other:?}"),
    };
    for value in [f32::NAN, f32::INFINITY, 2e12] {
        let said = format!(
            "the texel in column 0, row 1, counted from 0 at the top left, has the radiance {value}"
        );
        assert!(place(value).starts_with(&said), "{}", place(value));
    }
    let small = EnvironmentOptions { decode_limit: 100, ..Default::default() };
    let found = parse(&exr(2, 2, &[[0.0; 3]; 4]), &small);
    assert_eq!(found, Err(TooLarge { width: 2, height: 2, needed: 112, limit: 100 }));
    for strength in [-1.0, f32::NAN, 1e13, 1e12] {
        let options = EnvironmentOptions { strength, ..Default::default() };
        let found = parse(&exr(1, 1, &[[2.0; 3]]), &options);
        assert!(matches!(found, Err(Map(EnvironmentMapError::Strength { .. }))), "{strength}");
    }
    let options = EnvironmentOptions { rotation_degrees: f32::INFINITY, ..Default::default() };
    let found = parse(&exr(1, 1, &[[2.0; 3]]), &options);
    assert!(matches!(found, Err(Map(EnvironmentMapError::Rotation { .. }))));
}

/// Files that are cut off anywhere, or have any byte another, are read or refused.
#[test]
fn damaged_files_end_well() {
    let files = [radiance("EXPOSURE=1\n", "-Y 2 +X 2", &TEXELS), exr(3, 2, &[[0.5, 1.0, 2.0]; 6])];
    let options = EnvironmentOptions { decode_limit: 1 << 20, ..Default::default() };
    for (file, whole) in files.iter().enumerate() {
        let mut refused = 0;
        for at in 0..whole.len() {
            refused += u32::from(parse(&whole[..at], &options).is_err());
            for value in [0, 1, 0x7f, 0xff, whole[at] ^ 0x40] {
                let mut bytes = whole.clone();
                bytes[at] = value;
                if let Err(error) = parse(&bytes, &options) {
                    let text = error.to_string();
                    assert!(text.len() < 500 && !text.contains(char::is_control), "{file} {text}");
                }
            }
        }
        assert!(refused as usize > whole.len() / 2, "{file}: {refused} of {}", whole.len());
    }
}

#[test]
fn errors_name_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.hdr");
    let options = EnvironmentOptions::default();
    let missing = super::read(&path, &options).unwrap_err().to_string();
    assert!(missing.contains("sky.hdr`: there is no such file"), "{missing}");
    std::fs::write(&path, radiance("", "-Y 2 +X 2", &TEXELS)).unwrap();
    assert_eq!(super::read(&path, &options).unwrap().map.width(), 2);
    let small = EnvironmentOptions { file_limit: Some(10), ..options };
    let long = super::read(&path, &small).unwrap_err();
    assert!(long.problem.is_limit() && long.to_string().contains("more than 10 bytes"), "{long}");
}
