//! The viewer in a real window: a virtual X server, pixels taken by another program, keys and mouse
//! moved by a third.

#![cfg(target_os = "linux")]

use image::RgbaImage;
use std::collections::HashSet;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The window's size; the screen's is larger.
const SIZE: [u32; 2] = [900, 600];
/// The panel's width: the picture is left of it.
const PANEL: u32 = 292;
/// How long to wait for what must happen at last, on the slowest machine.
const PATIENCE: Duration = Duration::from_secs(300);

/// One X server at a time: two that start together may take the same number.
static ONE: Mutex<()> = Mutex::new(());

/// An X server without hardware, ended when dropped.
struct Display {
    server: Child,
    name: String,
    _one: MutexGuard<'static, ()>,
}

impl Display {
    fn start() -> Display {
        let one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1000x700x24", "-nolisten", "tcp"])
            // When its last client goes it would start anew, and refuse whoever comes just then.
            .arg("-noreset")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts; scripts/test.sh installs it");
        let mut number = String::new();
        let out = server.stdout.as_mut().expect("a pipe");
        BufReader::new(out).read_line(&mut number).expect("the display's number");
        Display { server, name: format!(":{}", number.trim()), _one: one }
    }

    /// The program on this display.
    fn view(&self, folder: &Path, arguments: &[&str]) -> Command {
        let mut command = view(folder, arguments);
        command.env("DISPLAY", &self.name);
        command
    }

    /// The program, left to itself.
    fn start_view(&self, folder: &Path) -> Running {
        Running(self.view(folder, &["builtin:cornell"]).spawn().expect("it starts"))
    }

    /// What the screen shows where the window is.
    fn screen(&self) -> RgbaImage {
        let dump = Command::new("xwd")
            .args(["-root", "-silent", "-display", &self.name])
            .output()
            .expect("xwd runs; scripts/test.sh installs it");
        assert!(dump.status.success(), "{}", text(&dump.stderr));
        window(&read_dump(&dump.stdout))
    }

    /// Waits until the window of the program shows what is expected.
    fn wait(
        &self,
        running: &mut Running,
        what: &str,
        seen: impl Fn(&RgbaImage) -> bool,
    ) -> RgbaImage {
        let start = Instant::now();
        loop {
            let ended = running.0.try_wait().expect("it is our child");
            assert_eq!(ended, None, "{what}: the program has ended");
            let screen = self.screen();
            if seen(&screen) {
                return screen;
            }
            if start.elapsed() > PATIENCE {
                let path = std::env::temp_dir().join("splitplane-viewer-test.png");
                let saved = screen.save(&path).map(|()| path);
                panic!("{what}: not seen; the window is in {saved:?}");
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Moves mouse and keyboard.
    fn act(&self, arguments: &[&str]) {
        let done = Command::new("xdotool")
            .args(arguments)
            .env("DISPLAY", &self.name)
            .output()
            .expect("xdotool runs; scripts/test.sh installs it");
        assert!(done.status.success(), "{arguments:?}: {}", text(&done.stderr));
    }

    /// Drags with the left button, slowly enough that frames are drawn meanwhile.
    fn drag(&self, from: [u32; 2], to: [u32; 2]) {
        let [[x, y], [to_x, to_y]] = [from, to].map(|point| point.map(|at| at.to_string()));
        self.act(&["mousemove", &x, &y, "sleep", "0.2", "mousedown", "1", "sleep", "0.2"]);
        self.act(&["mousemove", &to_x, &to_y, "sleep", "0.2", "mouseup", "1"]);
    }

    /// Presses a key in the window; without a window manager nobody else gives it the focus.
    fn press(&self, key: &str) {
        self.act(&["search", "--name", "^splitplane", "windowfocus", "--sync", "key", key]);
    }
}

/// Ends the server before the next one may start: fields are dropped afterwards.
impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// The program, ended when dropped.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn view(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_splitplane"));
    command.current_dir(folder).arg("view").args(arguments);
    command.args(["--size", &format!("{}x{}", SIZE[0], SIZE[1])]);
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    command.env_remove("RUST_BACKTRACE").env("NODEVICE_SELECT", "1");
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A dump of the X Window System, version 7: a header of 32-bit words from the most significant byte
/// on, a colour map, and rows of pixels of 32 bits, blue first on this machine's order.
fn read_dump(dump: &[u8]) -> RgbaImage {
    let word = |index: usize| {
        let at = index * 4;
        u32::from_be_bytes([dump[at], dump[at + 1], dump[at + 2], dump[at + 3]])
    };
    let (header, width, height) = (word(0), word(4), word(5));
    let (byte_order, bits_per_pixel, stride, colours) = (word(7), word(11), word(12), word(19));
    assert_eq!((word(1), byte_order, bits_per_pixel), (7, 0, 32), "an unknown kind of dump");
    let first = header as usize + colours as usize * 12;
    RgbaImage::from_fn(width, height, |x, y| {
        let at = first + y as usize * stride as usize + x as usize * 4;
        image::Rgba([dump[at + 2], dump[at + 1], dump[at], 255])
    })
}

/// The part of the screen that the window is in.
fn window(screen: &RgbaImage) -> RgbaImage {
    image::imageops::crop_imm(screen, 0, 0, SIZE[0], SIZE[1]).to_image()
}

/// The picture without the corner in which its caption is, and the panel.
fn parts(window: &RgbaImage) -> [RgbaImage; 2] {
    let width = SIZE[0] - PANEL;
    let crop = |x, y, w, h| image::imageops::crop_imm(window, x, y, w, h).to_image();
    [crop(0, 60, width, SIZE[1] - 60), crop(width, 0, PANEL, SIZE[1])]
}

fn colours(image: &RgbaImage) -> usize {
    image.pixels().map(|pixel| pixel.0).collect::<HashSet<_>>().len()
}

fn count(image: &RgbaImage, which: impl Fn([u8; 4]) -> bool) -> usize {
    image.pixels().filter(|pixel| which(pixel.0)).count()
}

fn is_grey([r, g, b, _]: [u8; 4]) -> bool {
    // The ground of debug views is nearly grey.
    r.abs_diff(g) <= 4 && g.abs_diff(b) <= 4
}

/// Red on the left and green on the right: the walls of the Cornell box.
fn shows_cornell_box(window: &RgbaImage) -> bool {
    let [picture, _] = parts(window);
    let red = count(&picture, |[r, g, b, _]| r > 100 && g < r / 2 && b < r / 2);
    let green = count(&picture, |[r, g, b, _]| {
        g > 100 && g > r.saturating_add(30) && g > b.saturating_add(30)
    });
    red > 10_000 && green > 10_000 && colours(&picture) > 200
}

/// A dark ground, text on it, and something that is chosen.
fn shows_panel(window: &RgbaImage) -> bool {
    let [_, panel] = parts(window);
    let pixels = (panel.width() * panel.height()) as usize;
    let dark = count(&panel, |[r, g, b, _]| r < 40 && g < 40 && b < 45);
    let bright = count(&panel, |[r, g, b, _]| r > 180 && g > 180 && b > 180);
    let chosen = count(&panel, |[r, g, b, _]| b > r.saturating_add(60) && g < b);
    dark > pixels / 2 && bright > 300 && chosen > 1000
}

fn differing(a: &RgbaImage, b: &RgbaImage) -> usize {
    a.pixels().zip(b.pixels()).filter(|(a, b)| a != b).count()
}

fn fails(mut command: Command, code: i32) -> String {
    let output: Output = command.output().expect("the program runs");
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{error}");
    let lines: Vec<&str> = error.lines().filter(|line| line.starts_with("splitplane: ")).collect();
    assert_eq!(lines.len(), 1, "{error}");
    lines[0].to_owned()
}

#[test]
#[cfg_attr(
    any(no_display, no_gpu),
    ignore = "no virtual display or no Vulkan adapter, and none could be installed"
)]
fn scene_panel_keys_and_mouse_in_a_window() {
    let folder = tempfile::tempdir().expect("a folder");
    let display = Display::start();
    let mut running = display.start_view(folder.path());
    let finished = |window: &RgbaImage| shows_cornell_box(window) && shows_panel(window);
    let shaded = display.wait(&mut running, "the scene and the panel", finished);

    // The second view is depth: shades of grey.
    display.press("2");
    let grey = |window: &RgbaImage| {
        let [picture, _] = parts(window);
        let all = (picture.width() * picture.height()) as usize;
        count(&picture, is_grey) == all && colours(&picture) > 100
    };
    let depth = display.wait(&mut running, "depth, in shades of grey", grey);
    assert!(differing(&shaded, &depth) > 100_000 && !shows_cornell_box(&depth));

    // The third is normals: the walls are red, green and blue.
    display.press("3");
    let normals = |window: &RgbaImage| {
        let [picture, _] = parts(window);
        let faces = [[255, 128, 128], [128, 255, 128], [128, 128, 255]];
        faces.iter().all(|face| count(&picture, |[r, g, b, _]| [r, g, b] == *face) > 1000)
    };
    let before = display.wait(&mut running, "normals", normals);

    // Dragging turns. A drag that begins and ends between two frames is a click, so it is tried
    // again until it is seen.
    let turned = |window: &RgbaImage| {
        let seen = differing(&parts(&before)[0], &parts(window)[0]) > 50_000;
        if !seen {
            display.drag([300, 300], [380, 310]);
        }
        seen
    };
    display.wait(&mut running, "the scene turned", turned);
    display.press("r");
    let [home, _] = parts(&before);
    display.wait(&mut running, "the camera where it was", |window| {
        differing(&parts(window)[0], &home) == 0
    });

    // Without the panel the picture takes all of the window.
    display.press("h");
    display.wait(&mut running, "no panel", |window| !shows_panel(window) && normals(window));
}

#[test]
#[cfg_attr(
    any(no_display, no_gpu),
    ignore = "no virtual display or no Vulkan adapter, and none could be installed"
)]
fn a_screenshot_is_what_the_window_shows() {
    let folder = tempfile::tempdir().expect("a folder");
    let display = Display::start();
    let arguments = [
        "builtin:cornell",
        "--stop-after",
        "3",
        "--screenshot",
        "window.png",
        "--json",
        "--threads",
        "2",
    ];
    let output = display.view(folder.path(), &arguments).output().expect("it runs");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one object");
    assert_eq!(report["scene"], "builtin:cornell");
    assert_eq!(report["triangles"], 30);
    assert!(report["nodes"].as_u64() > Some(0) && report["rays"].as_u64() > Some(100_000));
    let shot = image::open(folder.path().join("window.png")).expect("a picture").to_rgba8();
    assert_eq!([shot.width(), shot.height()], SIZE);
    assert!(shows_cornell_box(&shot) && shows_panel(&shot));
    // Seen from outside, the same scene is the same picture to the last bit.
    let mut running = display.start_view(folder.path());
    let [picture, _] = parts(&shot);
    display.wait(&mut running, "the picture of the screenshot", |window| {
        differing(&parts(window)[0], &picture) == 0 && shows_panel(window)
    });
}

#[test]
#[cfg_attr(
    any(no_display, no_gpu),
    ignore = "no virtual display or no Vulkan adapter, and none could be installed"
)]
fn boxes_of_the_tree_are_drawn_over_the_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    let display = Display::start();
    let shot = |name: &str, more: &[&str]| {
        let mut arguments = vec!["builtin:city:2000", "--view", "depth", "--screenshot", name];
        arguments.extend(more);
        let output = display.view(folder.path(), &arguments).output().expect("it runs");
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let image = image::open(folder.path().join(name)).expect("a picture").to_rgba8();
        let [picture, _] = parts(&image);
        count(&picture, |pixel| !is_grey(pixel))
    };
    assert_eq!(shot("plain.png", &[]), 0);
    let (one, many) = (shot("one.png", &["--boxes", "0"]), shot("many.png", &["--boxes", "7"]));
    assert!(one > 500, "{one}");
    assert!(many > 2 * one, "{one} {many}");
}

#[test]
#[cfg_attr(
    any(no_display, no_gpu),
    ignore = "no virtual display or no Vulkan adapter, and none could be installed"
)]
fn the_windows_own_device_gives_the_cpus_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    let display = Display::start();
    let shot = |backend: &str| {
        let arguments = ["builtin:cornell", "--backend", backend, "--view", "normals", "--json"];
        let mut command = display.view(folder.path(), &arguments);
        command.args(["--allow-structural", "--screenshot", "window.png"]);
        let output = command.output().expect("it runs");
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one object");
        let by = report["backend"].as_str().expect("a name").to_owned();
        assert!(by.starts_with(backend), "{by}");
        let image = image::open(folder.path().join("window.png")).expect("a picture").to_rgba8();
        let [picture, _] = parts(&image);
        picture
    };
    let (cpu, gpu) = (shot("cpu"), shot("wgpu"));
    assert!(colours(&cpu) > 3);
    // On an adapter that differs in some bits, so may a pixel on an edge.
    assert!(differing(&cpu, &gpu) < 100, "{}", differing(&cpu, &gpu));
}

#[test]
fn without_a_display_it_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let error = fails(view(folder.path(), &["builtin:cornell"]), 5);
    assert!(error.contains("there is no display to open a window on"), "{error}");
    assert!(error.contains("WAYLAND_DISPLAY") && !error.contains(".rs"), "{error}");
    let mut command = view(folder.path(), &["builtin:cornell"]);
    command.env("DISPLAY", ":no-such-display");
    let error = fails(command, 5);
    assert!(error.contains("there is no display"), "{error}");
}

#[test]
#[cfg_attr(no_display, ignore = "no virtual display, and none could be installed")]
fn without_an_adapter_it_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let display = Display::start();
    let mut command = display.view(folder.path(), &["builtin:cornell"]);
    command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
    let error = fails(command, 5);
    assert!(error.contains("no GPU adapter was found"), "{error}");
}

#[test]
fn wrong_usage_is_told_before_a_window_opens() {
    let folder = tempfile::tempdir().expect("a folder");
    let cases: [(&[&str], i32); 5] = [
        (&["builtin:nowhere"], 2),
        (&["missing.obj"], 3),
        (&["--screenshot", "window.jpg"], 2),
        (&["--view", "inside-out"], 2),
        (&["--stop-after", "0"], 2),
    ];
    for (arguments, code) in cases {
        let output = view(folder.path(), arguments).output().expect("it runs");
        assert_eq!(output.status.code(), Some(code), "{arguments:?} {}", text(&output.stderr));
    }
}
