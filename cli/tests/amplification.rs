//! Small files that ask for much: pictures of a header, one file by many names, files that never end.
//! Memory is counted, and what a verb does not show it does not read.

use image::{GrayImage, ImageFormat, Rgb, RgbImage};
use splitplane::scene::obj::{ObjProblem, read, read_with};
use splitplane::scene::{Scene, SceneOptions};
use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tempfile::TempDir;

/// Bytes that the process holds, the most it held, and all that it ever took.
static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);
static TAKEN: AtomicUsize = AtomicUsize::new(0);

fn take(bytes: usize) {
    TAKEN.fetch_add(bytes, Relaxed);
    PEAK.fetch_max(HELD.fetch_add(bytes, Relaxed) + bytes, Relaxed);
}

/// The system's allocator, which counts.
struct Counting;

// SAFETY: passes everything on to the system's allocator, and only adds up sizes.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        take(size);
        HELD.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// What a count says is about one test at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The most bytes that some work holds at once besides what is held before, and all that it takes.
fn counted<T>(work: impl FnOnce() -> T) -> (usize, usize, T) {
    let (held, taken) = (HELD.load(Relaxed), TAKEN.load(Relaxed));
    PEAK.store(held, Relaxed);
    let result = work();
    (PEAK.load(Relaxed) - held, TAKEN.load(Relaxed) - taken, result)
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n";

/// A scene file of one triangle for every one of `maps`, each of a material of its own with this as its
/// `map_Kd`.
fn scene(folder: &TempDir, maps: &[String]) -> PathBuf {
    let mut obj = format!("mtllib a.mtl\n{TRIANGLE}");
    let mut mtl = String::new();
    for (i, map) in maps.iter().enumerate() {
        obj += &format!("usemtl m{i}\nf 1/1 2/1 3/1\n");
        mtl += &format!("newmtl m{i}\nKd .5 .25 1\nmap_Kd {map}\n");
    }
    let path = folder.path().join("a.obj");
    fs::write(&path, obj).unwrap();
    fs::write(folder.path().join("a.mtl"), mtl).unwrap();
    path
}

/// A square picture of one bit a texel, all black: a few kilobytes whatever its side.
fn black(path: &Path, side: u32) {
    let file = std::io::BufWriter::new(fs::File::create(path).unwrap());
    let mut encoder = png::Encoder::new(file, side, side);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::One);
    encoder.set_compression(png::Compression::High);
    let row = vec![0; side.div_ceil(8) as usize];
    let mut writer = encoder.write_header().unwrap();
    let mut stream = writer.stream_writer().unwrap();
    for _ in 0..side {
        std::io::Write::write_all(&mut stream, &row).unwrap();
    }
    stream.finish().unwrap();
}

fn with_decode_limit(decode_limit: u64) -> SceneOptions {
    SceneOptions { decode_limit, ..SceneOptions::default() }
}

#[test]
fn a_large_picture_in_a_small_file_is_decoded_once_and_never_held_in_colour() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("0.png");
    black(&first, 16_384);
    assert!(fs::metadata(&first).unwrap().len() < 300_000);
    let mut maps = vec!["0.png".to_owned()];
    for i in 1..6 {
        let name = format!("{i}.png");
        fs::hard_link(&first, folder.path().join(&name)).unwrap();
        maps.push(name);
    }
    #[cfg(unix)]
    std::os::unix::fs::symlink("0.png", folder.path().join("6.png")).unwrap();
    #[cfg(unix)]
    maps.push("6.png".to_owned());
    let path = scene(&folder, &maps);
    let (peak, taken, scene) = counted(|| read(&path).unwrap());
    assert_eq!(scene.textures.len(), 1, "{:?}", scene.textures);
    assert!(scene.materials.iter().all(|material| material.texture == Some(0)));
    // A byte a texel while it is decoded; then a sixteenth as many texels of four bytes.
    let decoded = 16_384 * 16_384;
    assert_eq!(scene.textures[0].texels().len(), decoded / 16);
    assert!(peak < decoded + decoded / 2, "{peak}");
    assert!(taken < 12 * decoded, "{taken}");
}

#[test]
fn a_picture_past_the_limit_is_left_out_before_it_is_decoded() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    black(&folder.path().join("a.png"), 4096);
    let path = scene(&folder, &["a.png".to_owned()]);
    let bytes = 4096 * 4096;
    let (_, _, scene) = counted(|| read_with(&path, &with_decode_limit(bytes)).unwrap());
    assert_eq!((scene.textures.len(), &scene.notes.warnings[..]), (1, &[][..]));
    let (peak, _, scene) = counted(|| read_with(&path, &with_decode_limit(bytes - 1)).unwrap());
    assert!(scene.textures.is_empty());
    assert!(scene.notes.warnings[0].contains("decoding it takes 16777216 bytes, but 16777215"));
    assert!(peak < 1 << 20, "{peak}");
}

/// Their decoder holds all coefficients of one that comes in passes.
#[test]
fn the_memory_of_a_jpeg_is_known_from_its_header() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let side = 1024u32;
    let picture = RgbImage::from_fn(side, side, |x, y| Rgb([x as u8, y as u8, (x ^ y) as u8]));
    let file = folder.path().join("a.jpg");
    picture.save_with_format(&file, ImageFormat::Jpeg).unwrap();
    let bytes = fs::read(&file).unwrap();
    // In passes: the same header with another mark. What follows is not what it promises.
    let mut passes = bytes.clone();
    let mark = passes.windows(2).position(|two| two == [0xff, 0xc0]).unwrap();
    passes[mark + 1] = 0xc2;
    fs::write(folder.path().join("b.jpg"), &passes).unwrap();
    let texels = u64::from(side * side);
    for (name, times) in [("a.jpg", 3), ("b.jpg", 12)] {
        let needed = times * texels + 2 * bytes.len() as u64;
        let path = scene(&folder, &[name.to_owned()]);
        let (peak, _, scene) = counted(|| read_with(&path, &with_decode_limit(needed)).unwrap());
        // Texels of four bytes, and some rows of them, come on top.
        assert!((peak as u64) < needed + 6 * texels, "{name}: {peak}, {needed}");
        assert!(!scene.notes.warnings.iter().any(|why| why.contains("decoding it takes")));
        let (peak, _, scene) =
            counted(|| read_with(&path, &with_decode_limit(needed - 1)).unwrap());
        assert!(scene.notes.warnings[0].contains("decoding it takes"), "{:?}", scene.notes);
        assert!((peak as u64) < 4 * bytes.len() as u64 + (1 << 20), "{name}: {peak}");
    }
}

#[test]
fn all_pictures_together_are_decoded_within_a_limit() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let maps: Vec<String> = (0..18).map(|i| format!("{i}.png")).collect();
    for map in &maps {
        GrayImage::new(64, 64).save(folder.path().join(map)).unwrap();
    }
    let path = scene(&folder, &maps);
    let scene = read_with(&path, &with_decode_limit(64 * 64)).unwrap();
    assert_eq!(scene.textures.len() as u64, SceneOptions::DECODES);
    assert_eq!(scene.notes.warnings.len(), 2);
    assert!(scene.notes.warnings[0].contains("for all textures together"), "{:?}", scene.notes);
}

#[test]
fn a_material_file_is_read_once_by_whatever_names() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let inside = |name: &str| folder.path().join(name);
    let length = 1 << 20;
    let mtl = "newmtl a\nKd 1 0 0\n".to_owned() + &"#".repeat(length);
    fs::write(inside("a.mtl"), mtl).unwrap();
    let mut names = Vec::new();
    for i in 0..100 {
        let name = format!("l{i}.mtl");
        fs::hard_link(inside("a.mtl"), inside(&name)).unwrap();
        names.push(name);
        names.push("a.mtl".to_owned());
    }
    let lines: String = names.iter().map(|name| format!("mtllib {name}\n")).collect();
    let together = format!("mtllib {}\n", names.join(" "));
    for libraries in [lines, together] {
        fs::write(inside("a.obj"), format!("{libraries}{TRIANGLE}usemtl a\nf 1 2 3\n")).unwrap();
        let (_, taken, scene) = counted(|| read(&inside("a.obj")).unwrap());
        assert_eq!(scene.materials[0].diffuse, [1.0, 0.0, 0.0]);
        assert!(taken < 4 * length, "{taken}");
    }
    // What stands later counts, wherever the file stood before.
    fs::write(inside("b.mtl"), "newmtl a\nKd 0 1 0\n").unwrap();
    for (libraries, green) in [("a b a", false), ("a b", true), ("b a l0 b", true)] {
        let libraries: String =
            libraries.split(' ').map(|name| format!("mtllib {name}.mtl\n")).collect();
        fs::write(inside("a.obj"), format!("{libraries}{TRIANGLE}usemtl a\nf 1 2 3\n")).unwrap();
        let colour = if green { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
        assert_eq!(read(&inside("a.obj")).unwrap().materials[0].diffuse, colour, "{libraries}");
    }
}

/// What is kept of a material file is what the scene uses, and of what is odd in it the first.
#[test]
fn lines_of_a_material_file_cost_no_more_than_they_are() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let inside = |name: &str| folder.path().join(name);
    for line in ["newmtl a\n", "d\n", "map_Kd -s 2 2 a\n", "newmtl b\nd x\n"] {
        let mtl = "newmtl a\nKd 1 0 0\n".to_owned() + &line.repeat((4 << 20) / line.len());
        let length = mtl.len();
        fs::write(inside("a.mtl"), mtl).unwrap();
        fs::write(inside("a.obj"), format!("mtllib a.mtl\n{TRIANGLE}usemtl a\nf 1 2 3\n")).unwrap();
        let (peak, _, scene) = counted(|| read(&inside("a.obj")).unwrap());
        assert!(peak < length + (1 << 20), "{line:?}: {peak}");
        assert!(scene.notes.sentences().len() < 30);
    }
    // Files that are not there.
    let missing: String = (0..10_000).map(|i| format!("mtllib {i}.mtl\n")).collect();
    fs::write(inside("a.obj"), format!("{missing}{TRIANGLE}f 1 2 3\n")).unwrap();
    let scene = read(&inside("a.obj")).unwrap();
    assert_eq!(scene.notes.warnings.len(), 101);
    assert_eq!(scene.notes.warnings[100], "9900 more notes like these are left out");
}

#[test]
fn a_scene_has_so_many_materials_and_bytes() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    let names: String = (0..=1 << 20).map(|i| format!("usemtl {i:x}\n")).collect();
    fs::write(&path, format!("{TRIANGLE}{names}f 1 2 3\n")).unwrap();
    let error = read(&path).unwrap_err();
    assert_eq!(error.problem, ObjProblem::TooManyMaterials(1 << 20));
    assert_eq!(error.line, Some(4 + (1 << 20) + 1));
    // A megabyte that is not read.
    fs::write(&path, TRIANGLE.to_owned() + "f 1 2 3\n" + &"#".repeat(1 << 20)).unwrap();
    let length = fs::metadata(&path).unwrap().len();
    let with = |limit| SceneOptions { file_limit: Some(limit), ..SceneOptions::default() };
    assert!(read_with(&path, &with(length)).is_ok());
    let (peak, _, error) = counted(|| read_with(&path, &with(length - 1)).unwrap_err());
    assert_eq!(error.problem, ObjProblem::TooLong { limit: length - 1 });
    assert!(peak < 100_000, "{peak}");
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_splitplane"))
        .current_dir(folder)
        .args(arguments)
        .env_remove("RUST_BACKTRACE")
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// One that is read is said to be no picture.
#[test]
fn textures_are_read_where_they_are_seen() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.png"), "no picture").unwrap();
    scene(&folder, &["a.png".to_owned()]);
    fs::write(folder.path().join("some.rays"), [0; 32]).unwrap();
    let picture = ["render", "a.obj", "--size", "8x8", "-o", "a.out.png"];
    let trade = ["trade", "a.obj", "--quick", "--presets", "fast", "--no-knobs"];
    for (verb, reads) in [
        (&["build", "a.obj"][..], false),
        (&["stats", "a.obj", "--rays", "50"], false),
        (&["verify", "a.obj", "--rays", "50"], false),
        (&["query", "a.obj", "--rays", "some.rays"], false),
        (&[&trade[..], &["--no-picture"]].concat(), false),
        (&trade, true),
        (&picture, true),
        (&[&picture[..], &["--heatmap", "nodes"]].concat(), false),
        (&[&picture[..], &["--no-textures"]].concat(), false),
    ] {
        let output = run(folder.path(), &[verb, &["--backend", "cpu"]].concat());
        let notes = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{verb:?}: {notes}");
        assert_eq!(notes.contains("the texture `a.png`"), reads, "{verb:?}: {notes}");
        // That a surface has a texture is known all the same.
        assert!(!notes.contains("have no colour"), "{verb:?}: {notes}");
    }
}

#[test]
fn textures_past_the_limit_of_the_program_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    GrayImage::new(64, 64).save(folder.path().join("a.png")).unwrap();
    scene(&folder, &["a.png".to_owned()]);
    let with = ["render", "a.obj", "--backend", "cpu", "--size", "8x8", "-o", "b.png"];
    for (limit, fits) in [("4k", true), ("4095", false)] {
        let output = run(folder.path(), &[&with[..], &["--max-texture", limit]].concat());
        let notes = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{notes}");
        assert_eq!(!notes.contains("4095 are the most"), fits, "{notes}");
        assert_eq!(!notes.contains("--max-texture allows larger"), fits, "{notes}");
    }
}

/// Runs within an address space of so many kilobytes.
#[cfg(target_os = "linux")]
fn within(kilobytes: u64, folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let output = Command::new("sh")
        .current_dir(folder)
        .args(["-c", &format!("ulimit -v {kilobytes} && exec \"$@\""), "sh"])
        .arg(env!("CARGO_BIN_EXE_splitplane"))
        .args(arguments)
        // Threads take address space. Comparing reports takes none, and no such option.
        .args(if arguments.contains(&"--compare") { &[][..] } else { &["--threads", "1"] })
        .env_remove("RUST_BACKTRACE")
        .output()
        .unwrap();
    (output.status.code(), text(&output.stderr))
}

#[cfg(target_os = "linux")]
#[test]
fn files_that_never_end_do_end() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.obj"), format!("{TRIANGLE}f 1 2 3\n")).unwrap();
    let query = ["query", "a.obj", "--backend", "cpu", "--rays"];
    let fails = |arguments: &[&str], code: i32, words: &str| {
        let (found, error) = within(2_000_000, folder.path(), arguments);
        assert_eq!(found, Some(code), "{arguments:?}: {error}");
        assert!(error.contains(words), "{arguments:?}: {error}");
    };
    let endless = [&query[..], &["/dev/zero"]].concat();
    fails(&[&endless[..], &["--max-file", "1M"]].concat(), 4, "more than 1048576 bytes");
    fails(&endless, 4, "cannot read the rays in `/dev/zero`: ");
    let points = ["query", "a.obj", "--backend", "cpu", "--kind", "inside"];
    fails(&[&points[..], &["--points", "/dev/zero"]].concat(), 4, "the points in `/dev/zero`");
    fails(&[&query[..], &["/dev/null", "--hits", "h.bin"]].concat(), 0, "");
    fails(&["build", "/dev/zero"], 2, "neither a .obj file");
    std::os::unix::fs::symlink("/dev/zero", folder.path().join("zero.obj")).unwrap();
    fails(&["build", "zero.obj"], 3, "not a regular file");
    let compare = ["trade", "--compare", "/dev/zero"];
    fails(&compare, 3, "not a regular file");
    // A regular file that is no longer than it says, but longer than there is memory for.
    let sparse = fs::File::create(folder.path().join("sparse.rays")).unwrap();
    sparse.set_len(1 << 40).unwrap();
    fails(&[&query[..], &["sparse.rays"]].concat(), 4, "more than ");
    fails(&[&query[..], &["sparse.rays", "--max-file", "2048G"]].concat(), 4, "memory enough");
    let sparse = fs::File::create(folder.path().join("sparse.obj")).unwrap();
    sparse.set_len(1 << 40).unwrap();
    fails(&["build", "sparse.obj"], 4, "sparse.obj`: it has more than ");
    fails(&["build", "sparse.obj", "--max-file", "2048G"], 4, "memory enough");
}

/// A pipe is read to its end, which must be that of a ray.
#[cfg(unix)]
#[test]
fn a_pipe_of_rays_is_read_to_its_end() {
    use std::io::Write;
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.obj"), format!("{TRIANGLE}f 1 2 3\n")).unwrap();
    let pipe = folder.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for (length, more, code, words) in [
        (64, &[][..], 0, "2 rays"),
        (33, &[], 3, "33 bytes, which is not a multiple of 32"),
        (64, &["--max-file", "64"], 0, "2 rays"),
        (65, &["--max-file", "64"], 4, "more than 64 bytes"),
    ] {
        let writer = {
            let pipe = pipe.clone();
            std::thread::spawn(move || {
                let mut pipe = fs::OpenOptions::new().write(true).open(pipe).unwrap();
                // The reader may have gone when it had too much.
                let _ = pipe.write_all(&vec![0; length]);
            })
        };
        let query = ["query", "a.obj", "--backend", "cpu", "--rays", "pipe"];
        let output = run(folder.path(), &[&query[..], more].concat());
        writer.join().unwrap();
        let said = text(&output.stdout) + &text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{length}: {said}");
        assert!(said.contains(words), "{length}: {said}");
    }
}

/// The tests above leave the defaults alone.
#[test]
fn scenes_are_as_they_were() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    // A side of one and odd sides, halved once and more: what a row is made of does not depend on where
    // a part of the picture ends.
    for (width, height) in [(700, 900), (1, 3000), (3000, 1), (333, 777)] {
        let picture = RgbImage::from_fn(width, height, |x, y| {
            Rgb([(x * 7 + y) as u8, (x ^ y) as u8, (y * 3) as u8])
        });
        picture.save(folder.path().join("a.png")).unwrap();
        let path = scene(&folder, &["a.png".to_owned()]);
        let whole = read(&path).unwrap();
        for level in 1..6 {
            let [w, h] = [width, height].map(|side| u64::from((side >> level).max(1)));
            let options = SceneOptions { texture_limit: 4 * w * h, ..SceneOptions::default() };
            let found: Scene = read_with(&path, &options).unwrap();
            assert_eq!(found.textures[0].texels(), halved(&whole, level), "{width}x{height}");
        }
    }
}

/// The texels of a scene's texture, halved so many times as a whole.
fn halved(scene: &Scene, level: u32) -> Vec<[u8; 4]> {
    let texture = &scene.textures[0];
    let (mut width, mut height) = (texture.width() as usize, texture.height() as usize);
    let mut texels = texture.texels().to_vec();
    for _ in 0..level {
        let (half_width, half_height) = ((width / 2).max(1), (height / 2).max(1));
        let mut half = Vec::new();
        for y in 0..half_height {
            for x in 0..half_width {
                let (right, below) = ((2 * x + 1).min(width - 1), (2 * y + 1).min(height - 1));
                let at = |x: usize, y: usize| texels[y * width + x];
                let four = [at(2 * x, 2 * y), at(right, 2 * y), at(2 * x, below), at(right, below)];
                half.push(std::array::from_fn(|channel| {
                    let sum: u32 = four.iter().map(|texel| u32::from(texel[channel])).sum();
                    ((sum + 2) / 4) as u8
                }));
            }
        }
        (texels, width, height) = (half, half_width, half_height);
    }
    texels
}
