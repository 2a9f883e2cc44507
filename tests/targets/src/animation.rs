//! Frames as numbers: raw, with a description beside them, or as an array of NumPy, that fit together or do not.

use crate::folder;
use crate::source::Source;
use splitplane::scene::SceneOptions;
use splitplane::scene::animation::{Animation, AnimationError, Change};

/// Vertices of the scene.
const VERTICES: usize = 4;
const SCENE: &str =
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\n";

/// Bytes as the two files of raw frames.
pub fn run(data: &[u8]) {
    let mut source = Source::new(data);
    let scene = folder::path("still.obj");
    if !scene.is_file() {
        folder::write("still.obj", SCENE.as_bytes());
    }
    let frames = source.below(4);
    let description = description(&mut source, frames);
    folder::write("some.frames.json", description.as_bytes());
    let numbers: Vec<f32> = (0..frames * VERTICES * 3).map(|_| source.number()).collect();
    let mut bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_bits().to_le_bytes()).collect();
    match source.below(16) {
        14 => bytes.truncate(source.below(bytes.len() + 1)),
        15 => bytes.push(0),
        _ => {}
    }
    let bin = folder::write("some.frames.bin", &bytes);
    let named =
        source.pick(&["some.frames.bin", "some.frames.json", "some.frames", "some.frames.npy"]);
    let array = named.ends_with("npy").then(|| array(&mut source, frames, &bytes));
    let scene = scene.to_string_lossy().into_owned();
    let opened =
        Animation::open(&scene, Some(&bin.with_file_name(named)), &SceneOptions::default());
    let (mut scene, mut animation) = match opened {
        Ok(opened) => opened,
        Err(error) => return refused(&error),
    };
    let numbers: Vec<f32> = match array {
        // Any numbers may stand there now.
        Some(Array::Changed) => {
            (0..animation.frames().min(5)).for_each(|frame| drop(animation.set(frame, &mut scene)));
            return;
        }
        Some(Array::Wrong) => panic!("an array with a wrong head is read"),
        Some(Array::Wide) => numbers.iter().map(|x| f64::from(*x) as f32).collect(),
        Some(Array::Narrow) => numbers,
        None => {
            assert_eq!(bytes.len(), frames * VERTICES * 12, "{description}");
            numbers
        }
    };
    assert_eq!(animation.frames(), frames);
    for _ in 0..3 {
        let frame = source.below(frames + 1);
        match animation.set(frame, &mut scene) {
            Ok(change) => {
                assert!(frame < frames && change != Change::Everything);
                let of_frame = &numbers[frame * VERTICES * 3..][..VERTICES * 3];
                let bits = |x: &f32| x.to_bits();
                let found: Vec<u32> = scene.positions.as_flattened().iter().map(bits).collect();
                assert_eq!(found, of_frame.iter().map(bits).collect::<Vec<_>>());
                assert!(scene.mesh().is_ok());
            }
            Err(AnimationError::NoSuchFrame { .. }) => assert!(frame >= frames),
            Err(error) => panic!("{error}"),
        }
        let _ = (animation.camera(frame), animation.time(frame));
    }
}

/// What an array of frames is like.
enum Array {
    Narrow,
    /// Of f64.
    Wide,
    /// Its bytes were changed; it may be good or not.
    Changed,
    Wrong,
}

/// Writes the frames as an array, of f32 or of f64.
fn array(source: &mut Source<'_>, frames: usize, bytes: &[u8]) -> Array {
    let wide = source.once_in(2);
    let mut numbers = bytes.to_vec();
    if wide {
        let (narrow, _) = bytes.as_chunks::<4>();
        let wider = narrow.iter().map(|x| f64::from(f32::from_le_bytes(*x)).to_le_bytes());
        numbers = wider.flatten().collect();
    }
    let vertices = if source.once_in(6) { source.count() } else { VERTICES as u32 };
    let (kind, right) = match source.below(8) {
        0 => ("'>f4'", false),
        1 => ("'<i4'", false),
        _ => (if wide { "'<f8'" } else { "'<f4'" }, true),
    };
    let (order, in_rows) = if source.once_in(8) { ("True", false) } else { ("False", true) };
    let (last, three) =
        source.pick(&[("3", true), ("3", true), ("3,", true), ("4", false), ("3, 1", false)]);
    let text = format!(
        "{{'descr': {kind}, 'fortran_order': {order}, 'shape': ({frames}, {vertices}, {last}), }}\n"
    );
    let mut file = b"\x93NUMPY\x02\x00".to_vec();
    file.extend((text.len() as u32).to_le_bytes());
    file.extend(text.bytes());
    file.extend(&numbers);
    let changed = source.once_in(6) && crate::change(source, &mut file);
    folder::write("some.frames.npy", &file);
    let each = if wide { 24 } else { 12 };
    let whole = numbers.len() == frames * VERTICES * each && frames > 0;
    let right = right && in_rows && three && whole && vertices as usize == VERTICES;
    match (changed, right, wide) {
        (true, ..) => Array::Changed,
        (_, false, _) => Array::Wrong,
        (.., true) => Array::Wide,
        _ => Array::Narrow,
    }
}

fn refused(error: &AnimationError) {
    let message = error.to_string();
    crate::check_message(&message, "some.frames");
    let expected = matches!(
        error,
        AnimationError::BadDescription { .. }
            | AnimationError::Camera { .. }
            | AnimationError::WrongSize { .. }
            | AnimationError::VertexCount { .. }
            | AnimationError::Array { .. }
            | AnimationError::NotFrames(_)
            | AnimationError::Unreadable { .. }
    );
    assert!(expected, "{error:?}");
}

/// A description that is right, or wrong in one place or more.
fn description(source: &mut Source<'_>, frames: usize) -> String {
    let mut count = |right: usize| match source.below(24) {
        0..20 => right.to_string(),
        20 => "18446744073709551615".to_owned(),
        21 => source.pick(&["-1", "1.0", "1e400", "null", "\"4\"", "[]", ""]).to_owned(),
        _ => source.count().to_string(),
    };
    let mut fields = vec![
        format!("\"vertices\": {}", count(VERTICES)),
        format!("\"frames\": {}", count(frames)),
    ];
    if source.once_in(3) {
        let times: Vec<String> = (0..frames).map(|_| json_number(source)).collect();
        fields.push(format!("\"times_s\": [{}]", times.join(", ")));
    }
    if source.once_in(3) {
        let cameras: Vec<String> = (0..frames + usize::from(source.once_in(8)))
            .map(|_| {
                let mut point = || [(); 3].map(|()| json_number(source)).join(", ");
                format!("{{\"eye\": [{}], \"dir\": [{}], \"up\": [{}]}}", point(), point(), point())
            })
            .collect();
        fields.push(format!("\"camera_per_frame\": [{}]", cameras.join(", ")));
    }
    if source.once_in(4) {
        fields.push(format!("\"fov_y_deg\": {}", json_number(source)));
    }
    if source.once_in(8) {
        let which = source.below(fields.len());
        fields.swap(0, which);
        fields.push(fields[source.below(fields.len())].clone());
    }
    let mut text = format!("{{{}}}", fields.join(", "));
    if source.once_in(8) {
        let at = source.below(text.len());
        if text.is_char_boundary(at) {
            text.insert_str(at, source.pick(&["}", "[", "\"", "\u{0}", ",", "1", "[[[[[[[[[["]));
        }
    }
    text
}

fn json_number(source: &mut Source<'_>) -> String {
    match source.below(16) {
        0..12 => format!("{:?}", f64::from(source.step())),
        12 => source.pick(&["1e308", "-1e308", "1e-320", "null", "1e400"]).to_owned(),
        13 => format!("{:e}", source.finite()),
        _ => "1".to_owned(),
    }
}
