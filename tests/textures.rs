//! Textures of made files, broken in every way.

use image::{ImageFormat, Rgb, RgbImage};
use splitplane::scene::obj::{read, read_with};
use splitplane::scene::{Scene, SceneOptions};
use std::fs;
use std::path::Path;

/// A scene file of one triangle for every line of `maps`, each of a material of its own with this
/// as its `map_Kd`.
fn write(folder: &Path, maps: &[&str]) {
    let mut obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n".to_owned();
    let mut mtl = String::new();
    for (i, map) in maps.iter().enumerate() {
        obj += &format!("usemtl m{i}\nf 1/1 2/1 3/1\n");
        mtl += &format!("newmtl m{i}\nKd .5 .25 1\nmap_Kd {map}\n");
    }
    fs::write(folder.join("a.obj"), obj).unwrap();
    fs::write(folder.join("a.mtl"), mtl).unwrap();
}

fn open(folder: &Path, maps: &[&str]) -> Scene {
    write(folder, maps);
    read(&folder.join("a.obj")).unwrap()
}

/// A picture whose texels differ.
fn picture(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| Rgb([x as u8 * 5, y as u8 * 5, 200]))
}

#[test]
fn pictures_of_every_format_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let picture = picture(5, 3);
    let formats = [
        ("a.png", ImageFormat::Png),
        ("b.bmp", ImageFormat::Bmp),
        ("c.tga", ImageFormat::Tga),
        ("d.jpg", ImageFormat::Jpeg),
        // The contents count, not the ending.
        ("e.jpg", ImageFormat::Png),
    ];
    for (name, format) in formats {
        picture.save_with_format(folder.path().join(name), format).unwrap();
    }
    let scene = open(folder.path(), &formats.map(|(name, _)| name));
    assert_eq!(scene.notes, Default::default());
    assert_eq!(scene.textures.len(), 5);
    for (i, material) in scene.materials.iter().enumerate() {
        assert_eq!(material.texture, Some(i as u32));
        assert_eq!(material.diffuse, [0.5, 0.25, 1.0]);
        let texture = &scene.textures[i];
        assert_eq!((texture.name(), texture.width(), texture.height()), (formats[i].0, 5, 3));
        for (texel, want) in texture.texels().iter().zip(picture.pixels()) {
            let near = texel.iter().zip(want.0).all(|(a, b)| a.abs_diff(b) < 40);
            let same = texel[..3] == want.0;
            assert!(if formats[i].1 == ImageFormat::Jpeg { near } else { same }, "{texture:?}");
            assert_eq!(texel[3], 255);
        }
    }
}

#[test]
fn files_that_are_no_pictures_are_noted_and_the_colour_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("empty.png"), b"").unwrap();
    fs::write(path("text.png"), b"not a picture at all, but long enough to be one").unwrap();
    fs::create_dir(path("folder.png")).unwrap();
    picture(40, 40).save(path("whole.png")).unwrap();
    let whole = fs::read(path("whole.png")).unwrap();
    fs::write(path("cut.png"), &whole[..whole.len() / 2]).unwrap();
    let header_only = |name: &str, width: u32, height: u32| {
        // A PNG that promises this size; the check sum is right, the data is missing.
        let mut bytes = whole[..33].to_vec();
        bytes[16..20].copy_from_slice(&width.to_be_bytes());
        bytes[20..24].copy_from_slice(&height.to_be_bytes());
        let sum = crc(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&sum.to_be_bytes());
        bytes.extend(&whole[33..]);
        fs::write(path(name), bytes).unwrap();
    };
    header_only("wide.png", 1 << 30, 1);
    header_only("bomb.png", 16_384, 16_384);
    header_only("nothing.png", 0, 5);
    let names = [
        "missing.png",
        "empty.png",
        "text.png",
        "folder.png",
        "cut.png",
        "wide.png",
        "bomb.png",
        "nothing.png",
    ];
    let scene = open(folder.path(), &names);
    assert!(scene.textures.is_empty());
    assert_eq!(scene.notes.warnings.len(), names.len(), "{:#?}", scene.notes.warnings);
    for (i, name) in names.iter().enumerate() {
        assert_eq!(scene.materials[i].texture, None);
        assert_eq!(scene.materials[i].diffuse, [0.5, 0.25, 1.0]);
        let start = format!("the texture `{name}` of material `m{i}` is left out: ");
        assert!(scene.notes.warnings[i].starts_with(&start), "{:?}", scene.notes.warnings[i]);
    }
}

/// The check sum of PNG.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| (sum >> 1) ^ (0xedb8_8320 * (sum & 1)))
    })
}

#[test]
fn names_lead_to_files_in_many_ways() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("scene");
    fs::create_dir_all(inner.join("pictures")).unwrap();
    picture(2, 2).save(inner.join("my wood.png")).unwrap();
    picture(3, 3).save(inner.join("pictures/a.png")).unwrap();
    picture(4, 4).save(folder.path().join("up.png")).unwrap();
    let maps = [
        "my wood.png",
        "-s 1 1 1 my wood.png",
        "pictures\\a.png",
        "./pictures/../pictures/a.png",
        "../up.png",
        "C:\\work\\somebody\\my wood.png",
        "-s 2 2 -clamp on pictures/a.png",
    ];
    let scene = open(&inner, &maps);
    let textures: Vec<Option<u32>> = scene.materials.iter().map(|m| m.texture).collect();
    assert_eq!(textures, [0, 0, 1, 1, 2, 0, 1].map(Some));
    let sides: Vec<u32> = scene.textures.iter().map(|texture| texture.width()).collect();
    assert_eq!(sides, [2, 3, 4]);
    assert_eq!(
        scene.notes.warnings,
        [
            "material file `a.mtl`: the texture of material `m6` is used without its options -s 2 2 -clamp on"
        ]
    );
}

#[test]
fn textures_shrink_until_they_fit() {
    let folder = tempfile::tempdir().unwrap();
    picture(8, 8).save(folder.path().join("a.png")).unwrap();
    picture(6, 2).save(folder.path().join("b.png")).unwrap();
    picture(1, 5).save(folder.path().join("c.png")).unwrap();
    write(folder.path(), &["a.png", "b.png", "c.png"]);
    let sizes = |texture_limit| {
        let options = SceneOptions { texture_limit, ..SceneOptions::default() };
        let scene = read_with(&folder.path().join("a.obj"), &options).unwrap();
        assert_eq!(scene.materials[2].texture, Some(2));
        let sizes: Vec<[u32; 2]> = scene.textures.iter().map(|t| [t.width(), t.height()]).collect();
        (sizes, scene.notes.warnings.len())
    };
    let bytes = 4 * (64 + 12 + 5);
    assert_eq!(sizes(bytes), (vec![[8, 8], [6, 2], [1, 5]], 0));
    assert_eq!(sizes(bytes - 1), (vec![[4, 4], [6, 2], [1, 5]], 1));
    assert_eq!(sizes(4 * 12), (vec![[2, 2], [3, 1], [1, 5]], 1));
    assert_eq!(sizes(0), (vec![[1, 1]; 3], 1));
    let options = SceneOptions { texture_limit: 4 * 16, ..SceneOptions::default() };
    write(folder.path(), &["a.png"]);
    let scene = read_with(&folder.path().join("a.obj"), &options).unwrap();
    // The mean of texels (0, 0) to (1, 1).
    assert_eq!(scene.textures[0].texels()[0], [3, 3, 200, 255]);
    assert!(scene.notes.warnings[0].starts_with("1 textures are smaller than in their files"));
}

#[test]
fn textures_can_be_left_out() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &["missing.png"]);
    let options = SceneOptions { textures: false, ..SceneOptions::default() };
    let scene = read_with(&folder.path().join("a.obj"), &options).unwrap();
    assert!(scene.textures.is_empty() && scene.notes == Default::default());
}

#[test]
fn a_texture_under_black_is_seen() {
    let folder = tempfile::tempdir().unwrap();
    picture(2, 2).save(folder.path().join("a.png")).unwrap();
    write(folder.path(), &["a.png", "a.png"]);
    let mtl = "newmtl m0\nKd 0 0 0\nKs 1 1 1\nmap_Kd a.png\nnewmtl m1\nmap_kd a.png\n";
    fs::write(folder.path().join("a.mtl"), mtl).unwrap();
    let scene = read(&folder.path().join("a.obj")).unwrap();
    for material in &scene.materials {
        assert_eq!((material.diffuse, material.mirror), ([1.0; 3], [0.0; 3]), "{material:?}");
        assert_eq!(material.texture, Some(0));
    }
}
