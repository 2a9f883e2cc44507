//! The program from outside: the file it writes is one that `splitplane paper` takes.

use splitplane::report::others::Others;
use std::process::Command;

#[test]
fn the_file_can_be_read_and_says_what_was_traced() {
    let path = std::env::temp_dir().join(format!("splitplane-dbvh-{}.json", std::process::id()));
    let output = Command::new(env!("CARGO_BIN_EXE_splitplane-dbvh"))
        .args(["--size", "48x32", "--repeat", "1", "-o"])
        .arg(&path)
        .arg("builtin:carousel:4000@3")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let others = Others::read(&path);
    std::fs::remove_file(&path).unwrap();
    let others = others.unwrap();
    let [scene] = &others.scenes[..] else { panic!("{others:?}") };
    assert_eq!(scene.scene, "builtin:carousel:4000");
    assert_eq!(scene.camera_rays, 48 * 32);
    assert!(scene.shadow_rays > 48 * 32, "{scene:?}");
    // Its triangle test may leak at edges.
    assert!(scene.different <= 2, "{scene:?}");
}

#[test]
fn what_is_wrong_is_said() {
    let run = |arguments: &[&str]| {
        let output =
            Command::new(env!("CARGO_BIN_EXE_splitplane-dbvh")).args(arguments).output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, said) = run(&["--repeat", "2"]);
    assert!(code == Some(2) && said.contains("odd"), "{said}");
    let (code, said) = run(&["nothing.obj"]);
    assert!(code == Some(1) && said.contains("nothing.obj"), "{said}");
}
