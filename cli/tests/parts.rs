//! Pictures that are rendered in parts and merged, from outside: the bytes of one `render`, and what is refused.

use crate::common::{fail, run, succeed};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const CPU: [&str; 6] = ["--backend", "cpu", "--quiet", "--size", "33x21", "--seed=3"];

fn part(index: u32, count: u32) -> String {
    format!("{index}-{count}.picpart")
}

/// Renders the parts of a picture and gives their names.
fn parts(folder: &TempDir, count: u32, options: &[&str]) -> Vec<String> {
    let names = (1..=count).map(|index| {
        let (name, of) = (part(index, count), format!("{index}/{count}"));
        let arguments = [&["render"], options, &CPU, &["--part", &of, "-o", &name]].concat();
        succeed(folder, &arguments);
        name
    });
    names.collect()
}

fn read(folder: &Path, name: &str) -> Vec<u8> {
    fs::read(folder.join(name)).unwrap()
}

#[test]
fn merged_pictures_are_those_of_one_render() {
    let aovs = ["--aov", "depth,normal,triangle,instance,nodes,tests"];
    let of_aovs = ["depth", "normal", "triangle", "instance", "nodes", "tests"];
    let photons = ["--transport", "photons", "--photons", "2000", "--passes", "2"];
    let cases: [(Vec<&str>, &[&str], &[u32]); 6] = [
        ([&["builtin:spheres", "--samples", "3"][..], &aovs].concat(), &of_aovs, &[1, 2, 3, 7]),
        (vec!["builtin:gallery", "--samples", "2", "--transport", "paths"], &[], &[2, 7]),
        ([&["builtin:cornell", "--samples", "2"][..], &photons].concat(), &[], &[1, 3]),
        ([&["builtin:cornell", "--gather", "final"][..], &photons].concat(), &[], &[2]),
        ([&["builtin:forest:20", "--samples", "2"][..], &aovs].concat(), &of_aovs, &[3]),
        (vec!["builtin:spheres", "--heatmap", "nodes"], &[], &[2]),
    ];
    for (options, beside, counts) in cases {
        let folder = tempfile::tempdir().unwrap();
        let is_heatmap = options.contains(&"--heatmap");
        let mut endings = vec!["png"];
        endings.extend((!is_heatmap).then_some("exr"));
        for ending in &endings {
            let whole = format!("whole.{ending}");
            succeed(&folder, &[&["render"], &options[..], &CPU, &["-o", &whole]].concat());
        }
        for &count in counts {
            let mut names = parts(&folder, count, &options);
            // In any order.
            names.reverse();
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            for ending in &endings {
                let merged = format!("merged.{ending}");
                let said = succeed(&folder, &[&["merge"], &names[..], &["-o", &merged]].concat());
                assert!(said.contains(&format!("merged   {count} part")), "{said}");
                assert_eq!(said.contains("cost     nodes"), is_heatmap, "{said}");
                let whole = read(folder.path(), &format!("whole.{ending}"));
                assert!(read(folder.path(), &merged) == whole, "{options:?} {count} {ending}");
            }
            for aov in beside {
                let [merged, whole] = ["merged", "whole"].map(|name| format!("{name}.{aov}.png"));
                assert!(read(folder.path(), &merged) == read(folder.path(), &whole), "{aov}");
            }
        }
    }
}

#[test]
fn parts_that_make_no_picture_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let spheres = ["builtin:spheres", "--samples", "1"];
    let names = parts(&folder, 3, &spheres);
    let [one, two, three] = &names[..] else { panic!() };
    let merge = |code, names: &[&str], output: &str| {
        let error = fail(&folder, code, &[&["merge"], names, &["-o", output]].concat());
        assert!(!folder.path().join(output).exists());
        error
    };
    let error = merge(3, &[one, three], "a.png");
    assert!(error.contains("of 3 parts one is missing: 2"), "{error}");
    let error = merge(3, &[two], "a.png");
    assert!(error.contains("of 3 parts these are missing: 1, 3"), "{error}");
    fs::copy(folder.path().join(two), folder.path().join("copy.picpart")).unwrap();
    let error = merge(3, &[one, two, three, "copy.picpart"], "a.png");
    let said = format!("part 2/3 is there twice, in `{two}` and in `copy.picpart`");
    assert!(error.contains(&said), "{error}");
    for (options, said) in [
        (&["builtin:spheres", "--samples", "4"][..], "`samples` is 4, not 1"),
        (&["builtin:spheres", "--samples", "1", "--exposure", "2"], "`exposure` is 2.0, not 1.0"),
        (&["builtin:spheres", "--samples", "1", "--aov", "depth"], "`outputs` is {"),
        (&["builtin:spheres", "--samples", "1", "--preset", "best"], "`tree` is "),
        (&["builtin:spheres", "--samples", "1", "--accuracy", "exact"], "`accuracy` is exact"),
        (&["builtin:spheres", "--samples", "1", "--size", "9x9"], "`size` is 9x9, not 33x21"),
        (&["builtin:spheres", "--samples", "1", "--light", "1,9,1"], "`materials and lights` is"),
    ] {
        let mut arguments = vec!["render", "--part", "2/3", "-o", "other.picpart"];
        arguments.extend(options);
        arguments.extend(CPU.iter().filter(|_| !options.contains(&"--size")));
        if options.contains(&"--size") {
            arguments.extend(["--backend", "cpu", "--quiet", "--seed=3"]);
        }
        succeed(&folder, &arguments);
        let error = merge(3, &[one, "other.picpart", three], "a.png");
        let begins = format!("`other.picpart` is of another picture than `{one}`: ");
        assert!(error.contains(&begins) && error.contains(said), "{error}");
    }
    // No files, files of another kind, damaged ones, too long ones.
    let all = names.iter().map(String::as_str);
    let error = merge(3, &[one, two, "no.picpart"], "a.png");
    assert!(error.contains("cannot read the part in `no.picpart`"), "{error}");
    fs::write(folder.path().join("bad.picpart"), b"v 0 0 0\n").unwrap();
    let error = merge(3, &[one, "bad.picpart", three], "a.png");
    assert!(error.contains("`bad.picpart`: it does not start as the file of a part"), "{error}");
    let mut bytes = read(folder.path(), two);
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    fs::write(folder.path().join("bad.picpart"), &bytes).unwrap();
    let error = merge(3, &[one, "bad.picpart", three], "a.png");
    assert!(error.contains("`bad.picpart`: its last 8 bytes are not the checksum"), "{error}");
    fs::write(folder.path().join("bad.picpart"), &bytes[..middle]).unwrap();
    let error = merge(3, &[one, "bad.picpart", three], "a.png");
    let said = format!("promises {} bytes in all, but it has {middle}", bytes.len());
    assert!(error.contains(&said), "{error}");
    let limited: Vec<&str> = all.clone().chain(["--max-file", "100"]).collect();
    let error = merge(4, &limited, "a.png");
    assert!(error.contains("more than 100 bytes") && error.contains("--max-file"), "{error}");
    // It is for all parts together.
    let total: usize = names.iter().map(|name| read(folder.path(), name).len()).sum();
    let [less, enough] = [total - 1, total].map(|bytes| bytes.to_string());
    let limited: Vec<&str> = all.clone().chain(["--max-file", &less]).collect();
    let error = merge(4, &limited, "a.png");
    assert!(error.contains(&format!("what is left of {less} for all parts")), "{error}");
    let limited = all.clone().chain(["-o", "limited.png", "-q", "--max-file", &enough]);
    succeed(&folder, &["merge"].into_iter().chain(limited).collect::<Vec<_>>());
    // Wrong usage.
    let all: Vec<&str> = all.collect();
    assert!(merge(2, &all, "a.jpg").contains("does not end in .png or .exr"));
    assert!(fail(&folder, 2, &["merge", "-o", "a.png"]).contains("PART.picpart"));
    for (part, said) in [
        ("0/3", "there is no part 0"),
        ("4/3", "there is no part 4"),
        ("1/0", "1 to 65536 parts"),
        ("1/65537", "1 to 65536 parts"),
        ("x", "INDEX/COUNT"),
        ("1/2/3", "INDEX/COUNT"),
    ] {
        let error = fail(&folder, 2, &["render", "builtin:spheres", "--part", part]);
        assert!(error.contains(said), "{part}: {error}");
    }
    let png = ["render", "builtin:spheres", "--part", "1/2", "-o", "a.png"];
    assert!(fail(&folder, 2, &png).contains("does not end in .picpart"));
    let output = run(folder.path(), &["render", "builtin:spheres", "-o", "a.picpart"]);
    assert_eq!(output.status.code(), Some(2));
}

/// Without `-o` a part has the names of scene and part.
#[test]
fn parts_have_names_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    for part in ["1/2", "2/2"] {
        let arguments = [&["render", "builtin:spheres", "--part", part][..], &CPU].concat();
        succeed(&folder, &arguments);
    }
    let json = succeed(
        &folder,
        &[
            "merge",
            "splitplane-spheres-1-of-2.picpart",
            "splitplane-spheres-2-of-2.picpart",
            "-o",
            "a.png",
            "--json",
        ],
    );
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    let expected = serde_json::json!({
        "parts": 2, "width": 33, "height": 21, "output": ["a.png"]
    });
    assert_eq!(report, expected);
}

/// Parts of an animation are shares of its frames.
#[test]
fn frames_are_shared_out() {
    for scene in ["builtin:carousel:4000", "builtin:flock:20"] {
        let folder = tempfile::tempdir().unwrap();
        let small = ["--size", "24x16", "--backend", "cpu", "--quiet", "--count", "5"];
        succeed(&folder, &[&["animate", scene, "--out", "whole"][..], &small].concat());
        for part in ["1/3", "2/3", "3/3"] {
            let of = ["animate", scene, "--out", "parts", "--part", part];
            succeed(&folder, &[&of[..], &small].concat());
        }
        for number in 0..5 {
            let [whole, part] = ["whole", "parts"].map(|of| format!("{of}/frame-{number:04}.png"));
            assert!(read(folder.path(), &whole) == read(folder.path(), &part), "{scene} {number}");
        }
        assert_eq!(fs::read_dir(folder.path().join("parts")).unwrap().count(), 5);
        let many = ["animate", scene, "--out", "more", "--part", "1/6"];
        let error = fail(&folder, 2, &[&many[..], &small].concat());
        assert!(error.contains("the animation has 5 frames, so this part has none"), "{error}");
        let alone = ["animate", scene, "--part", "1/2"];
        assert!(fail(&folder, 2, &alone).contains("--out <DIR>"));
        let movie = ["animate", scene, "--out", "o", "--part", "1/2", "--movie", "a.gif"];
        assert!(fail(&folder, 2, &movie).contains("--movie"));
    }
}
