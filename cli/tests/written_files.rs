//! Files that the program writes: through links, in place of others, together, and on its way out.

#![cfg(unix)]

use crate::common::{self, text};
use splitplane_test_support as _;
use std::ffi::OsStr;
use std::fs;
use std::io::ErrorKind;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";

const PROGRAM: &str = env!("CARGO_BIN_EXE_splitplane");

fn square() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("square.obj"), SQUARE).unwrap();
    let ray = [0.5f32, 0.25, 2.0, 0.0, 0.0, -1.0, 0.0, 9.0];
    let bytes: Vec<u8> = ray.iter().flat_map(|x| x.to_le_bytes()).collect();
    fs::write(folder.path().join("one.rays"), bytes).unwrap();
    folder
}

fn program(folder: &TempDir) -> Command {
    common::program(folder.path())
}

fn run(folder: &TempDir, arguments: &[&str]) -> Output {
    program(folder).args(arguments).args(["--backend", "cpu"]).output().unwrap()
}

fn succeed(folder: &TempDir, arguments: &[&str]) {
    let output = run(folder, arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A slip of the hand costs nobody a scene.
#[test]
fn nothing_is_written_over_what_is_read() {
    let folder = square();
    let path = |name: &str| folder.path().join(name);
    let converted =
        program(&folder).args(["convert", "square.obj", "square.ply"]).output().unwrap();
    assert!(converted.status.success(), "{}", text(&converted.stderr));
    symlink(path("square.obj"), path("link.obj")).unwrap();
    let contents = || names(folder.path()).into_iter().map(|name| fs::read(path(&name)).unwrap());
    let before: Vec<Vec<u8>> = contents().collect();
    for (arguments, over) in [
        (&["build", "square.obj", "-o", "./square.obj"][..], "./square.obj"),
        (&["build", "link.obj", "-o", "square.obj"], "square.obj"),
        (&["distances", "square.obj", "--out", "square.obj"], "square.obj"),
        (&["distances", "square.obj", "--out", "link.obj"], "link.obj"),
        (&["query", "square.obj", "--rays", "one.rays", "--hits", "one.rays"], "one.rays"),
        (&["query", "square.obj", "--rays", "one.rays", "--hits", "square.obj"], "square.obj"),
        (
            &[
                "query",
                "square.obj",
                "--kind",
                "inside",
                "--points",
                "one.rays",
                "--hits",
                "one.rays",
            ],
            "one.rays",
        ),
    ] {
        let output = run(&folder, arguments);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(&format!("`{over}` is read already")), "{arguments:?}: {said}");
        assert!(contents().eq(before.iter().cloned()), "{arguments:?}");
    }
    for arguments in [
        &["convert", "square.ply", "square.ply"][..],
        &["merge", "one.picpart", "--output", "one.picpart"],
    ] {
        let output = program(&folder).args(arguments).output().unwrap();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains("is read already"), "{arguments:?}: {said}");
    }
    assert!(contents().eq(before));
}

/// Every verb that writes, and what it writes to.
const WRITERS: [(&[&str], &str); 5] = [
    (&["build", "square.obj", "-o", "out.bin"], "out.bin"),
    (&["render", "square.obj", "--size", "8x8", "-o", "out.png"], "out.png"),
    (&["query", "square.obj", "--rays", "one.rays", "--hits", "out.npy"], "out.npy"),
    (&["animate", "--count", "1", "--size", "8x8", "--movie", "out.gif"], "out.gif"),
    (&["query", "square.obj", "--rays", "one.rays", "--kind", "all", "--hits", "o.bin"], "o.bin"),
];

/// A link at a name that can be foreseen leads nobody to overwrite what it leads to.
#[test]
fn planted_links_are_not_followed() {
    for (arguments, name) in WRITERS {
        let folder = square();
        fs::write(folder.path().join("victim"), "precious").unwrap();
        // The shell's number is that of the program, which takes its place.
        let script = format!("ln -s victim {name}.$$.part && exec \"$@\"");
        let output = Command::new("sh")
            .current_dir(folder.path())
            .args(["-c", &script, "sh", PROGRAM])
            .args(arguments)
            .args(["--backend", "cpu"])
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert_eq!(fs::read(folder.path().join("victim")).unwrap(), b"precious", "{name}");
        assert!(!folder.path().join(name).is_symlink(), "{name}");
        assert!(fs::metadata(folder.path().join(name)).unwrap().len() > 0, "{name}");
    }
}

#[test]
fn permissions_of_a_file_that_is_replaced_stay() {
    for (arguments, name) in WRITERS {
        let folder = square();
        let path = folder.path().join(name);
        let mode = || fs::metadata(&path).unwrap().mode() & 0o7777;
        succeed(&folder, arguments);
        // A new one has those that others get.
        fs::write(folder.path().join("other"), "").unwrap();
        let usual = fs::metadata(folder.path().join("other")).unwrap().mode() & 0o7777;
        assert_eq!(mode(), usual, "{name}");
        for kept in [0o600, 0o640, 0o666, 0o755] {
            fs::write(&path, "old").unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(kept)).unwrap();
            succeed(&folder, arguments);
            assert_eq!(mode(), kept, "{name}");
            assert_ne!(fs::read(&path).unwrap(), b"old", "{name}");
        }
    }
}

/// Who may give files to other groups sees that the group stays; for all others it cannot change.
#[test]
fn the_group_of_a_file_that_is_replaced_stays() {
    let folder = square();
    let (arguments, name) = WRITERS[0];
    let path = folder.path().join(name);
    fs::write(&path, "old").unwrap();
    let own = fs::metadata(&path).unwrap().gid();
    let other = own + 1;
    let expected = match std::os::unix::fs::chown(&path, None, Some(other)) {
        Ok(()) => other,
        Err(error) => {
            assert_eq!(error.kind(), ErrorKind::PermissionDenied);
            own
        }
    };
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
    succeed(&folder, arguments);
    let about = fs::metadata(&path).unwrap();
    assert_eq!((about.gid(), about.mode() & 0o7777), (expected, 0o640));
    assert_ne!(fs::read(&path).unwrap(), b"old");
}

#[test]
fn all_hits_do_not_go_to_a_pipe_or_a_device() {
    let folder = square();
    for name in ["/dev/stdout", "/dev/null"] {
        let arguments =
            ["query", "square.obj", "--rays", "one.rays", "--kind", "all", "--hits", name];
        let output = program(&folder).args(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        assert_eq!(output.stdout, b"");
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(error.contains("all hits are two files") && error.contains(name), "{error}");
    }
}

/// A stream may lead to a file that others write to as well.
#[test]
fn streams_go_on_behind_what_is_there() {
    let folder = square();
    let log = folder.path().join("log");
    fs::write(&log, "before\n").unwrap();
    let to = fs::OpenOptions::new().append(true).open(&log).unwrap();
    let arguments =
        ["query", "square.obj", "--rays", "one.rays", "--hits", "/dev/stdout", "--quiet"];
    let status = program(&folder).args(arguments).stdout(to).status().unwrap();
    assert!(status.success());
    let bytes = fs::read(&log).unwrap();
    assert!(bytes.starts_with(b"before\n") && bytes.len() >= 7 + 16, "{bytes:?}");
}

#[test]
fn a_link_stays_and_what_it_leads_to_is_replaced() {
    for (arguments, name) in WRITERS {
        let folder = square();
        let path = folder.path().join(name);
        let home = folder.path().join("home");
        fs::create_dir(&home).unwrap();
        // By two links, the second one in another folder; then to what is not there yet.
        symlink("home/second", &path).unwrap();
        symlink("target", home.join("second")).unwrap();
        for there in [true, false] {
            match there {
                true => fs::write(home.join("target"), "old").unwrap(),
                false => fs::remove_file(home.join("target")).unwrap(),
            }
            succeed(&folder, arguments);
            assert!(path.is_symlink() && home.join("second").is_symlink(), "{name}");
            assert!(fs::metadata(home.join("target")).unwrap().is_file(), "{name}");
            assert_ne!(fs::read(home.join("target")).unwrap(), b"old", "{name}");
            assert_eq!(names(&home), ["second", "target"], "{name}");
        }
    }
    let folder = square();
    symlink("b.bin", folder.path().join("a.bin")).unwrap();
    symlink("a.bin", folder.path().join("b.bin")).unwrap();
    let output = run(&folder, &["build", "square.obj", "-o", "a.bin"]);
    assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("cannot write `a.bin`"));
}

/// As the help says: other names of a file keep the old contents.
#[test]
fn hard_links_keep_the_old_contents() {
    let folder = square();
    fs::write(folder.path().join("one.bin"), "old").unwrap();
    fs::hard_link(folder.path().join("one.bin"), folder.path().join("two.bin")).unwrap();
    succeed(&folder, &["build", "square.obj", "-o", "one.bin"]);
    assert_ne!(fs::read(folder.path().join("one.bin")).unwrap(), b"old");
    assert_eq!(fs::read(folder.path().join("two.bin")).unwrap(), b"old");
}

/// What is printed and what is written may go the same way.
#[test]
fn standard_output_is_written_to_and_not_replaced() {
    let folder = square();
    let file = fs::File::create(folder.path().join("printed")).unwrap();
    let all = ["query", "square.obj", "--rays", "one.rays", "--quiet", "--backend", "cpu"];
    symlink("/dev/stdout", folder.path().join("out")).unwrap();
    let number = fs::metadata(folder.path().join("printed")).unwrap().ino();
    let status = program(&folder).args(all).args(["--hits", "out"]).stdout(file).status().unwrap();
    assert_eq!(status.code(), Some(0));
    let about = fs::metadata(folder.path().join("printed")).unwrap();
    assert_eq!((about.ino(), about.len()), (number, 16));
    assert!(folder.path().join("out").is_symlink());
}

#[test]
fn the_two_files_of_all_hits_appear_together() {
    let folder = square();
    let all = ["query", "square.obj", "--rays", "one.rays", "--kind", "all", "--hits", "all.bin"];
    // A file cannot take the place of a folder.
    fs::create_dir(folder.path().join("all.starts.bin")).unwrap();
    let before = names(folder.path());
    let output = run(&folder, &all);
    assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("cannot write `all.starts.bin`"));
    assert_eq!(names(folder.path()), before);
    fs::write(folder.path().join("all.bin"), "old").unwrap();
    assert_eq!(run(&folder, &all).status.code(), Some(3));
    assert_eq!(fs::read(folder.path().join("all.bin")).unwrap(), b"old");
    fs::remove_dir(folder.path().join("all.starts.bin")).unwrap();
    succeed(&folder, &all);
    assert_eq!(fs::metadata(folder.path().join("all.bin")).unwrap().len(), 20);
    assert_eq!(fs::metadata(folder.path().join("all.starts.bin")).unwrap().len(), 16);
}

/// Sends a signal to a run whose movie has begun; it never ends by itself. Gives the exit code.
fn signal_in_a_movie(folder: &TempDir, signal: &str, ignored: bool) -> (Option<i32>, String) {
    let count = if ignored { "400" } else { "1000000" };
    let movie = ["animate", "builtin:carousel:4000", "--movie", "out.png", "--size", "16x16"];
    let number = match signal {
        "TERM" => libc::SIGTERM,
        "HUP" => libc::SIGHUP,
        _ => libc::SIGINT,
    };
    // Said in either case: the tests themselves may have been started by `nohup`.
    let handler = if ignored { libc::SIG_IGN } else { libc::SIG_DFL };
    let mut command = program(folder);
    command
        .args(movie)
        .args(["--count", count, "--backend", "cpu", "--quiet"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    // SAFETY: `signal` may be called between fork and exec.
    let mut running = unsafe {
        command.pre_exec(move || {
            libc::signal(number, handler);
            Ok(())
        })
    }
    .spawn()
    .unwrap();
    // Under whatever name.
    while names(folder.path()).len() < 3 {
        if let Some(status) = running.try_wait().unwrap() {
            let output = running.wait_with_output().unwrap();
            panic!("it ended before its movie began: {status}, {}", text(&output.stderr));
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert!(running.try_wait().unwrap().is_none(), "it ended before the signal");
    let id = running.id().to_string();
    assert!(Command::new("kill").args(["-s", signal, &id]).status().unwrap().success());
    let output = running.wait_with_output().unwrap();
    (output.status.code(), text(&output.stderr))
}

#[test]
fn a_run_that_is_asked_to_end_leaves_nothing() {
    for signal in ["TERM", "HUP", "INT"] {
        let folder = square();
        let before = names(folder.path());
        let (code, error) = signal_in_a_movie(&folder, signal, false);
        assert_eq!(code, Some(7), "{signal}: {error}");
        assert!(error.contains("splitplane: cancelled"), "{signal}: {error}");
        assert_eq!(names(folder.path()), before, "{signal}");
    }
}

/// Whoever starts it by `nohup` wants it to go on.
#[test]
fn a_signal_that_is_to_be_ignored_is_ignored() {
    let folder = square();
    let (code, error) = signal_in_a_movie(&folder, "HUP", true);
    assert_eq!((code, error.as_str()), (Some(0), ""));
    assert_eq!(names(folder.path()), ["one.rays", "out.png", "square.obj"]);
}

/// A folder and a file of names that are no UTF-8, with all that a scene may name in them.
#[cfg(target_os = "linux")]
#[test]
fn paths_need_not_be_utf8() {
    let folder = square();
    let inner = folder.path().join(OsStr::from_bytes(b"in\xffner"));
    fs::create_dir(&inner).unwrap();
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";
    let scene = inner.join(OsStr::from_bytes(b"sc\xe9ne.obj"));
    fs::write(&scene, obj).unwrap();
    fs::write(inner.join("a.mtl"), "newmtl m\nKd 1 0 0\nmap_Kd a.png\n").unwrap();
    image::RgbImage::new(2, 2)
        .save_with_format(inner.join("a.png"), image::ImageFormat::Png)
        .unwrap();
    let rays = inner.join(OsStr::from_bytes(b"r\xff.rays"));
    fs::copy(folder.path().join("one.rays"), &rays).unwrap();
    let frames = inner.join(OsStr::from_bytes(b"fr\xff"));
    fs::create_dir(&frames).unwrap();
    fs::copy(&scene, frames.join(OsStr::from_bytes(b"\xff0.obj"))).unwrap();
    fs::copy(inner.join("a.mtl"), frames.join("a.mtl")).unwrap();
    fs::copy(inner.join("a.png"), frames.join("a.png")).unwrap();
    let os = |text: &str| OsStr::new(text).to_owned();
    let out = inner.join(OsStr::from_bytes(b"out\xff.png"));
    let hits = inner.join(OsStr::from_bytes(b"h\xff.bin"));
    let report = inner.join(OsStr::from_bytes(b"report\xff"));
    let mut asked = scene.clone().into_os_string();
    asked.push("@1");
    let scene = scene.into_os_string();
    for arguments in [
        vec![os("build"), scene.clone()],
        vec![os("stats"), scene.clone(), os("--rays=50")],
        vec![os("verify"), scene.clone(), os("--rays=50"), os("--json")],
        vec![os("query"), scene.clone(), os("--rays"), rays.into(), os("--hits"), hits.into()],
        vec![os("render"), scene.clone(), os("--size=8x8"), os("-o"), out.clone().into()],
        vec![os("animate"), scene.clone(), os("--frames"), frames.into(), os("--size=8x8")],
        vec![os("paper"), os("--quick"), os("--scene"), asked, os("--out"), report.into()],
    ] {
        let output = program(&folder).args(&arguments).arg("--backend=cpu").output().unwrap();
        let (said, notes) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {notes}");
        assert!(!notes.contains("left out:") && !notes.contains("no colour"), "{notes}");
        let shown = said.contains("sc\u{fffd}ne.obj");
        assert!(shown || said.contains("\"rays\":150"), "{arguments:?}: {said}");
    }
    assert!(out.exists());
    let missing = folder.path().join(OsStr::from_bytes(b"m\xff.obj"));
    let output = program(&folder).arg("build").arg(missing).output().unwrap();
    assert_eq!(output.status.code(), Some(3));
    assert!(text(&output.stderr).contains("m\u{fffd}.obj`: there is no such file"));
}
