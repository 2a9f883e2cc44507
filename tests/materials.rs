//! What .mtl files become.

use proptest::prelude::*;
use splitplane::scene::obj::{read, read_with};
use splitplane::scene::{Dielectric, Material, MaterialRule, Scene, SceneOptions};
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;

/// A file of one triangle of a material `m`, whose library is this text.
fn file(mtl: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    let obj = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    fs::write(&path, obj).unwrap();
    fs::write(folder.path().join("a.mtl"), format!("newmtl m\n{mtl}\n")).unwrap();
    (folder, path)
}

fn scene(mtl: &str, rule: MaterialRule) -> Scene {
    let (_folder, path) = file(mtl);
    read_with(&path, &SceneOptions { materials: rule, ..SceneOptions::default() }).unwrap()
}

fn material(mtl: &str) -> Material {
    scene(mtl, MaterialRule::Illum).materials.remove(0)
}

fn diffuse(colour: [f32; 3]) -> Material {
    Material::new("m", colour)
}

#[test]
fn every_rule_has_its_material() {
    let black = diffuse([0.0; 3]);
    let grey = diffuse([0.5; 3]);
    let glass = |index: f32, tint: [f32; 3]| Some(Dielectric { refractive_index: index, tint });
    let rows: [(&str, Material); 26] = [
        // Diffuse.
        ("Kd .5 .5 .5", grey.clone()),
        ("Kd .5", grey.clone()),
        ("Kd .5 .5 .5\nKs .9 .9 .9\nillum 2", grey.clone()),
        ("Kd .5 .5 .5\nKs .9 .9 .9\nillum 10\nNi 1.5", grey.clone()),
        ("Kd 2 -1 0.5", diffuse([1.0, 0.0, 0.5])),
        ("Kd 0 0 0\nKs 0 0 0", black.clone()),
        // Mirrors.
        ("Kd .5 .5 .5\nKs .2 .2 .2\nillum 3", grey.clone().with_mirror([0.2; 3])),
        ("Kd .5 .5 .5\nKs .2 .2 .2\nillum 5", grey.clone().with_mirror([0.2; 3])),
        ("Kd .5 .5 .5\nKs .8 .8 .8\nillum 8", grey.clone().with_mirror([0.8; 3])),
        ("Kd .5 .5 .5\nillum 3", grey.clone()),
        ("Kd 0 0 0\nKs .9 .8 .7\nillum 2", black.clone().with_mirror([0.9, 0.8, 0.7])),
        ("Ks .9 .8 .7", black.clone().with_mirror([0.9, 0.8, 0.7])),
        // Clear by `illum`: the tint is Tf.
        ("Kd .5 .5 .5\nNi 1.33\nillum 7", grey.clone().with_dielectric(1.33, [1.0; 3])),
        ("Kd .5\nNi 1.5\nTf .9 1 .9\nillum 4", grey.clone().with_dielectric(1.5, [0.9, 1.0, 0.9])),
        ("Ni 1.5\nillum 9", black.clone().with_dielectric(1.5, [1.0; 3])),
        ("Kd .5\nd 0.75\nillum 6", grey.clone().with_dielectric(1.0, [1.0; 3])),
        ("Ni 1e9\nillum 6", black.clone().with_dielectric(10.0, [1.0; 3])),
        // What some programs write for everything.
        ("Kd .5 .5 .5\nTf 1 1 1\nNi 1\nillum 4", grey.clone()),
        // Clear by `d` or `Tr`: what could not be scattered goes through.
        (
            "Kd 0 0 0\nKs .9 .9 .9\nd 0.25\nNi 1.5\nillum 2",
            black.clone().with_dielectric(1.5, [0.75; 3]),
        ),
        ("Kd 0 0 0\nTr 1", black.clone().with_dielectric(1.0, [1.0; 3])),
        ("Kd 0 0 0\nd 0.5\nTr 1", black.clone().with_dielectric(1.0, [0.5; 3])),
        ("Kd .5\nd 0.5\nNi 1.5", grey.clone().with_dielectric(1.5, [0.75; 3])),
        ("Kd 0\nd 0\nTf 1 .5 0", black.clone().with_dielectric(1.0, [1.0, 0.5, 0.0])),
        ("Kd .5\nd 0.75\nNi 1.5", grey.clone()),
        // Light.
        ("Kd 0 0 0\nKe 125 100 75", black.clone().with_emission([125.0, 100.0, 75.0])),
        ("Ke 1\nKd .5", grey.clone().with_emission([1.0; 3])),
    ];
    for (mtl, want) in rows {
        assert_eq!(material(mtl), want, "{mtl}");
    }
    assert_eq!(material("Kd 0\nd 0.1\nNi 1.5").dielectric, glass(1.5, [0.9; 3]));
}

#[test]
fn specular_surfaces_are_mirrors_when_asked() {
    let specular = |mtl| scene(mtl, MaterialRule::Specular).materials.remove(0);
    let grey = diffuse([0.5; 3]);
    assert_eq!(specular("Kd .5\nKs .2 0 0\nillum 2"), grey.clone().with_mirror([0.2, 0.0, 0.0]));
    assert_eq!(specular("Kd .5\nKs .05\nillum 2"), grey);
    assert_eq!(specular("Kd .5\nKs .05\nillum 3"), grey);
    let glass = specular("Kd 0\nKs .9\nNi 1.5\nd 0.1");
    assert_eq!(glass.dielectric.map(|d| d.refractive_index), Some(1.5));
}

#[test]
fn what_is_not_as_written_is_noted() {
    let notes = |mtl| scene(mtl, MaterialRule::Illum).notes.warnings;
    let rows = [
        ("Kd .5\nd .25\nTr .25", "1 materials have a `d` and a `Tr` that do not add up to 1"),
        ("Kd .5\nillum 4", "1 materials ask for refraction by `illum` only"),
        ("Kd .5\nd .9", "1 materials are more opaque than clear"),
        ("Ns 10", "1 materials have no colour, the first is `m`"),
        ("Kd .5\nKs x", "material file `a.mtl`: 1 lines left out, the first is line 3: `x`"),
    ];
    for (mtl, want) in rows {
        let found = notes(mtl);
        assert!(found.len() == 1 && found[0].starts_with(want), "{mtl}: {found:?}");
    }
    assert_eq!(material("Ns 10"), Material { name: "m".into(), ..Material::clay() });
    for fine in ["Kd .5", "Kd .5\nd 1\nTr 0", "Kd .5\nd .25\nTr .75", "Kd 0\nNi 1.5\nillum 7"] {
        assert_eq!(notes(fine), [""; 0], "{fine}");
    }
}

#[test]
fn libraries_are_found_with_the_slashes_of_another_system() {
    let (folder, path) = file("Kd 1 0 0");
    fs::create_dir(folder.path().join("sub")).unwrap();
    fs::rename(folder.path().join("a.mtl"), folder.path().join("sub/a.mtl")).unwrap();
    let text = fs::read_to_string(&path).unwrap().replace("a.mtl", "sub\\a.mtl");
    fs::write(&path, text).unwrap();
    assert_eq!(read(&path).unwrap().materials[0], diffuse([1.0, 0.0, 0.0]));
}

#[test]
fn the_scenes_of_real_files_have_their_materials() {
    let Some(folder) = splitplane_test_support::scenes::folder() else { return };
    let open = |name: &str, rule| {
        let options = SceneOptions { materials: rule, ..SceneOptions::default() };
        read_with(&folder.join(name), &options).unwrap()
    };
    let bathroom = open("bathroom.obj", MaterialRule::Illum);
    let named = |name: &str| bathroom.materials.iter().find(|m| m.name == name).unwrap();
    let glass = named("RoughGlass").dielectric.unwrap();
    assert_eq!((glass.refractive_index, glass.tint), (1.5, [0.9; 3]));
    assert_eq!(named("Mirror").mirror, [0.9; 3]);
    assert!(named("Ceramic").is_diffuse() && !named("Ceramic").is_mirror());
    assert_eq!(named("light11").emission, [125.0, 100.0, 75.0]);
    assert!(bathroom.is_lit());
    let mirrors = |rule| {
        open("robots.obj", rule).materials.iter().filter(|material| material.is_mirror()).count()
    };
    assert_eq!(mirrors(MaterialRule::Illum), 0);
    assert!(mirrors(MaterialRule::Specular) > 50);
}

/// Lines that look like those of .mtl files, with every kind of mistake.
fn line() -> impl Strategy<Value = String> {
    let keyword = prop::sample::select(vec![
        "newmtl", "Kd", "Ks", "Ke", "Tf", "Ni", "d", "Tr", "illum", "map_Kd", "#", "x", "",
    ]);
    let word = prop_oneof![
        any::<f32>().prop_map(|x| x.to_string()),
        (-2i64..11).prop_map(|x| x.to_string()),
        prop::sample::select(vec![
            "-s", "-o", "-mm", "-clamp", "on", "m", "a.obj", "\\", "\"", "nan"
        ])
        .prop_map(str::to_owned),
    ];
    (keyword, prop::collection::vec(word, 0..5))
        .prop_map(|(keyword, words)| format!("{keyword} {}\n", words.join(" ")))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn text_like_mtl_gives_materials_within_range(lines in prop::collection::vec(line(), 0..20)) {
        for rule in [MaterialRule::Illum, MaterialRule::Specular] {
            for material in scene(&lines.concat(), rule).materials {
                let parts = [material.diffuse, material.mirror];
                prop_assert!(parts.as_flattened().iter().all(|part| (0.0..=1.0).contains(part)));
                let mut sums = material.diffuse.iter().zip(material.mirror).map(|(a, b)| a + b);
                prop_assert!(sums.all(|sum| sum <= 1.0));
                prop_assert!(material.emission.iter().all(|part| *part >= 0.0 && part.is_finite()));
                if let Some(body) = material.dielectric {
                    prop_assert!(Dielectric::INDEX_RANGE.contains(&body.refractive_index));
                    prop_assert!(body.tint.iter().all(|part| (0.0..=1.0).contains(part)));
                }
                prop_assert!(material.texture.is_none());
            }
        }
    }
}
