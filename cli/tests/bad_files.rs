//! The program on generated bad input: files, options and limits. It always ends with a documented
//! exit code and one sentence that names what is wrong.

use splitplane_test_support::random::Random;
use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Runs of the program.
const RUNS: u64 = 240;
/// A run takes a few milliseconds; one that takes so long hangs.
const HANGS: Duration = Duration::from_secs(600);

const GOOD: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf -1 -2 -3\n";

/// Arguments, the exit code they must end with, and what the message must name.
struct Case {
    arguments: Vec<String>,
    code: i32,
    names: String,
}

fn case(arguments: &[&str], code: i32, names: &str) -> Case {
    let arguments = arguments.iter().map(|argument| (*argument).to_owned()).collect();
    Case { arguments, code, names: names.to_owned() }
}

/// An OBJ file with one line wrong, and which.
fn broken_scene(random: &mut Random) -> (String, u64) {
    let bad = random.pick(&[
        "v 1 2",
        "v 1 2 x",
        "v",
        "v 1 2 3 4 5 6 \u{1b}[31m",
        "vn 1 0",
        "vt",
        "f 0 1 2",
        "f 1 2 99",
        "f -9 1 2",
        "f 1/1 2 3",
        "f 1//7 2 3",
        "f a b c",
        "f 1 2 99999999999999999999",
        "f 1 2 -9223372036854775808",
        "f 1 2 4294967297",
        "f 1.0 2 3",
    ]);
    let mut lines: Vec<&str> = GOOD.lines().collect();
    let at = 4 + random.below(lines.len() - 3);
    lines.insert(at, bad);
    let ending = random.pick(&["\n", "\r\n"]);
    (lines.join(ending) + ending, at as u64 + 1)
}

fn rays(random: &mut Random) -> Vec<u8> {
    let odd = [0.0, -0.0, 1.0, f32::NAN, f32::INFINITY, 1e-40, 3e38, -1.0, 0.25];
    (0..8 * random.below(40)).flat_map(|_| random.pick(&odd).to_le_bytes()).collect()
}

/// The bytes of no part of a picture, and what is said of them.
fn bad_part(random: &mut Random) -> (Vec<u8>, &'static str) {
    let mut bytes = b"PICPART\0".to_vec();
    let text = random.pick(&[
        ("{}", "missing field"),
        ("{", "is damaged"),
        ("\u{1b}[2J", "is damaged"),
        (
            r#"{"index":3,"count":2,"width":4,"height":4,"wanted":{"aov":[],"heatmap":null,"heatmap_top":null},"settings":{}}"#,
            "there is no part 3",
        ),
        (
            r#"{"index":1,"count":1,"width":16384,"height":4096,"wanted":{"aov":[],"heatmap":null,"heatmap_top":null},"settings":{}}"#,
            "promises 1073741",
        ),
        (
            r#"{"index":1,"count":1,"width":4294967295,"height":2,"wanted":{"aov":[],"heatmap":null,"heatmap_top":null},"settings":{}}"#,
            "4294967295x2 pixels cannot be made",
        ),
    ]);
    let (version, length, names) = match random.below(6) {
        0 => (2u32, text.0.len() as u32, "its version is 2"),
        1 => (1, u32::MAX, "at most 65536"),
        2 => (1, 60_000, "within the first 60016"),
        _ => (1, text.0.len() as u32, text.1),
    };
    bytes.extend(version.to_le_bytes());
    bytes.extend(length.to_le_bytes());
    bytes.extend(text.0.bytes());
    bytes.extend([0; 8]);
    match random.below(8) {
        0 => (bytes[..random.below(8)].to_vec(), "bad.picpart"),
        _ => (bytes, names),
    }
}

/// Arguments for one thread of the CPU.
fn with<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [more, &["--backend", "cpu", "--threads", "1"]].concat()
}

/// Files are written into the folder as the case needs them.
fn generate(random: &mut Random, folder: &TempDir) -> Case {
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (scene, ray_file) = (path("good.obj"), path("some.rays"));
    fs::write(&scene, GOOD).unwrap();
    fs::write(&ray_file, rays(random)).unwrap();
    let verb = random.pick(&["build", "stats", "verify"]);
    match random.below(14) {
        0 | 1 => {
            let (text, line) = broken_scene(random);
            fs::write(path("bad.obj"), text).unwrap();
            case(&with(&[verb, &path("bad.obj")]), 3, &format!("bad.obj`, line {line}: "))
        }
        2 => {
            let bytes =
                random.pick(&[&b""[..], b"v 0 0 0\n", b"\xff\xfe", b"\0\0\0", b"f\n", b"\x89PNG"]);
            fs::write(path("bad.obj"), bytes).unwrap();
            case(&with(&[verb, &path("bad.obj")]), 3, "bad.obj")
        }
        3 => {
            let mut bytes = rays(random);
            bytes.push(0);
            let name = path(random.pick(&["bad.rays", "bad.npy"]));
            fs::write(&name, bytes).unwrap();
            case(&with(&["query", &scene, "--rays", &name]), 3, "bad.")
        }
        4 => {
            let (option, value, names) = random.pick(&[
                ("--max-depth", "0", "--max-depth"),
                ("--max-depth", "97", "--max-depth"),
                ("--block-width", "65", "--block-width"),
                ("--small-node-limit", "4294967295", "--small-node-limit"),
                ("--bins", "7", "--bins"),
                ("--empty-bonus", "10", "--empty-bonus"),
                ("--threads", "0", "--threads"),
                ("--threads", "nan", "--threads"),
                ("--max-memory", "-1", "-1"),
                ("--max-memory", "99999999999G", "--max-memory"),
                ("--preset", "worst", "--preset"),
                ("--accuracy", "", "--accuracy"),
                ("--empty-cutoff", "nan", "--empty-cutoff"),
                ("--empty-cutoff", "101", "--empty-cutoff"),
                ("--traversal-cost", "4294967296", "--traversal-cost"),
                ("--no-such-option", "1", "--no-such-option"),
            ]);
            case(&[verb, &scene, "--backend", "cpu", option, value], 2, names)
        }
        5 => {
            let limit = random.pick(&["0", "1", "100", "1k"]);
            case(&with(&[verb, &scene, "--max-memory", limit]), 4, "limit of")
        }
        6 => {
            let scene = random.pick(&[
                "builtin:nothing",
                "builtin:city:0",
                "builtin:city:nan",
                "a.fbx",
                "",
                "builtin:",
            ]);
            let names = if scene.starts_with("builtin:city") { scene } else { "built-in" };
            case(&with(&[verb, scene]), 2, names.trim_end_matches(":0").trim_end_matches(":nan"))
        }
        7 => {
            let missing = path(random.pick(&["no.obj", "no/such.obj", "good.obj/x.obj"]));
            case(&with(&[verb, &missing]), 3, &missing)
        }
        8 => case(&with(&["query", &scene, "--rays", &path("no.rays")]), 3, "no.rays"),
        9 => {
            let (output, into) = random.pick(&[("--hits", "no/such/file"), ("--hits", ".")]);
            let into = path(into);
            case(&with(&["query", &scene, "--rays", &ray_file, output, &into]), 3, "cannot write")
        }
        12 => {
            let (bytes, names) = bad_part(random);
            fs::write(path("bad.picpart"), bytes).unwrap();
            let output = path("out.png");
            case(&["merge", &path("bad.picpart"), "-o", &output], 3, names)
        }
        13 => {
            let (bytes, names) = random.pick(&[
                (&b""[..], "does not start"),
                (b"\x93NUMPX\x01\x00\x00\x00", "does not start"),
                (b"\x93NUMPY\x09\x00\x00\x00", "version 9"),
                (b"\x93NUMPY\x01\x00\xff\xff{", "header is damaged"),
                (b"\x93NUMPY\x02\x00\xff\xff\xff\xff{", "header is damaged"),
                (
                    b"\x93NUMPY\x01\x00\x3d\x00{'descr': '<f4', 'fortran_order': False, 'shape': (1, 4, 3)}\n",
                    "promises 48 bytes of numbers, but 0 follow",
                ),
            ]);
            fs::write(path("bad.npy"), bytes).unwrap();
            case(&with(&["animate", &scene, "--frames", &path("bad.npy")]), 3, names)
        }
        10 => {
            let kind = random.pick(&["closest", "any"]);
            let preset = random.pick(&["fast", "balanced", "best"]);
            case(
                &with(&["query", &scene, "--rays", &ray_file, "--kind", kind, "--preset", preset]),
                0,
                "",
            )
        }
        _ => {
            // Odd numbers are no error: what cannot be hit is left out and counted.
            let odd = random.pick(&["nan", "inf", "-0", "1e-45", "3e38", "1e39"]);
            let library = "mtllib \u{1b}[2J.mtl\nusemtl \u{1b}[31m\n";
            let text = format!("{library}v {odd} 1 {odd}\n{GOOD}f 1 2 3\nf 1 1 1\n");
            fs::write(path("odd.obj"), text).unwrap();
            case(&with(&[verb, &path("odd.obj")]), 0, "")
        }
    }
}

/// The exit code and what was printed; a run that does not end is ended.
fn run(folder: &TempDir, arguments: &[String]) -> (Option<i32>, String, String) {
    let mut program = Command::new(env!("CARGO_BIN_EXE_splitplane"))
        .current_dir(folder.path())
        .args(arguments)
        .args(
            arguments
                .first()
                .filter(|verb| *verb == "stats" || *verb == "verify")
                .map(|_| "--rays=50"),
        )
        .env_remove("RUST_BACKTRACE")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let start = Instant::now();
    let status = loop {
        if let Some(status) = program.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > HANGS {
            program.kill().unwrap();
            panic!("{arguments:?} hangs");
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let (mut out, mut err) = (String::new(), String::new());
    program.stdout.take().unwrap().read_to_string(&mut out).unwrap();
    program.stderr.take().unwrap().read_to_string(&mut err).unwrap();
    (status.code(), out, err)
}

#[test]
fn bad_files_and_options_end_in_their_exit_codes() {
    let mut codes: BTreeMap<i32, u64> = BTreeMap::new();
    for seed in 0..RUNS {
        let folder = tempfile::tempdir().unwrap();
        let case = generate(&mut Random::new(seed), &folder);
        let (code, _, error) = run(&folder, &case.arguments);
        let shown = &case.arguments;
        assert_eq!(code, Some(case.code), "{seed}: {shown:?}: {error}");
        assert!(
            !error.contains("panicked") && !error.contains("bug"),
            "{seed}: {shown:?}: {error}"
        );
        assert!(!error.contains('\u{1b}'), "{seed}: control characters of a file: {error:?}");
        assert!(error.contains(&case.names), "{seed}: `{}` is not named: {error}", case.names);
        // Wrong usage is said by the parser of arguments or by us, the rest in one sentence.
        let sentences = error.lines().filter(|line| line.starts_with("splitplane: ")).count();
        let by_parser = error.starts_with("error: ");
        assert_eq!(sentences, usize::from(case.code != 0 && !by_parser), "{shown:?}: {error}");
        assert!(!by_parser || code == Some(2));
        *codes.entry(case.code).or_default() += 1;
    }
    for (code, least) in [(0, 20), (2, 20), (3, 60), (4, 10)] {
        assert!(codes.get(&code).is_some_and(|count| *count >= least), "{codes:?}");
    }
}

/// An .npy file with this dictionary.
fn npy(dictionary: &str) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x02\x00".to_vec();
    bytes.extend((dictionary.len() as u32).to_le_bytes());
    bytes.extend(dictionary.bytes());
    bytes
}

/// What a file says may be quoted: so much of it as a line holds, and nothing that commands a terminal.
#[test]
fn messages_quote_files_shortly_and_printably() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    let evil = "\u{1b}]0;evil\u{7}\u{9b}31m\u{7f}\r".repeat(20_000);
    let json = serde_json::to_string(&evil).unwrap();
    write("good.obj", GOOD.as_bytes());
    write("type.npy", npy(&format!("{{'descr': '{evil}', 'shape': (1, 8)}}")).as_slice());
    let sides = "7,\u{1b}".repeat(100_000);
    let shape = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({sides})}}");
    write("sides.npy", &npy(&shape));
    let shape = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': (1,{evil}8)}}");
    write("shape.npy", &npy(&shape));
    let shape = format!(
        "{{'descr': '<f4', 'fortran_order': False, 'shape': (1,{}8)}}",
        "7,".repeat(100_000)
    );
    write("long.npy", &npy(&shape));
    write("a.frames.bin", &[0; 48]);
    write("a.frames.json", format!("{{\"vertices\": {json}, \"frames\": 1}}").as_bytes());
    write("b.frames.json", format!("{{\"vertices\": 4, \"frames\": {json}").as_bytes());
    write("c.json", format!("{{{json}: 1}}").as_bytes());
    for text in [
        format!("v {evil} 1 1\n{GOOD}"),
        format!("{GOOD}f {evil} 1 2\n"),
        format!("f 1 2 9\n{GOOD}usemtl {evil}\n"),
    ] {
        write("bad.obj", text.replace('\r', "").as_bytes());
        let (code, _, error) = run(&folder, &case(&with(&["build", "bad.obj"]), 3, "").arguments);
        assert_eq!(code, Some(3), "{error:.1000}");
        check_message(&error);
    }
    let name = evil.replace(['/', '\0'], "").chars().take(90).collect::<String>() + ".obj";
    write(&name, format!("{GOOD}f 1 2 x\n").as_bytes());
    write(
        "odd.obj",
        format!("mtllib {0}\nusemtl {0}\n{0} 1\n{GOOD}", evil.replace('\r', "")).as_bytes(),
    );
    let query = |rays: &str| with(&["query", "good.obj", "--rays", rays]).join("\n");
    for (arguments, code) in [
        (query("type.npy"), 3),
        (query("sides.npy"), 3),
        (query("shape.npy"), 3),
        (query("long.npy"), 3),
        (with(&["animate", "good.obj", "--frames", "a.frames.json"]).join("\n"), 3),
        (with(&["animate", "good.obj", "--frames", "b.frames.json"]).join("\n"), 3),
        ("trade\n--compare\nc.json".to_owned(), 3),
        (with(&["build", "odd.obj"]).join("\n"), 0),
    ] {
        let arguments: Vec<&str> = arguments.split('\n').collect();
        let (found, out, error) = run(&folder, &case(&arguments, code, "").arguments);
        assert_eq!(found, Some(code), "{arguments:?}: {error:.1000}");
        check_message(&error);
        check_message(&out);
    }
    // A name that commands a terminal, on both streams, and as JSON.
    for more in [&[][..], &["--json"]] {
        let (code, out, error) =
            run(&folder, &case(&with(&[&["build", &name][..], more].concat()), 3, "").arguments);
        assert_eq!(code, Some(3), "{error:.1000}");
        check_message(&(out + &error));
        write(&name, GOOD.as_bytes());
        let (code, out, error) =
            run(&folder, &case(&with(&[&["build", &name][..], more].concat()), 0, "").arguments);
        assert_eq!(code, Some(0), "{error:.1000}");
        check_message(&(out.clone() + &error));
        if !more.is_empty() {
            let report: serde_json::Value = serde_json::from_str(&out).unwrap();
            assert_eq!(report["scene"], name.as_str());
        }
        write(&name, format!("{GOOD}f 1 2 x\n").as_bytes());
    }
}

/// Lines that can be printed, none of which runs on.
fn check_message(text: &str) {
    let commands = |letter: char| letter.is_control() && letter != '\n';
    assert!(!text.contains(commands), "{text:.3000?}");
    assert!(text.lines().all(|line| line.len() < 3000), "{text:.3000}");
}
