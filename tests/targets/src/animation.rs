//! Raw frames: a description and the numbers beside it, that fit together or do not.

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
    let named = source.pick(&["some.frames.bin", "some.frames.json", "some.frames"]);
    let scene = scene.to_string_lossy().into_owned();
    let opened =
        Animation::open(&scene, Some(&bin.with_file_name(named)), &SceneOptions::default());
    let (mut scene, mut animation) = match opened {
        Ok(opened) => opened,
        Err(error) => return refused(&error),
    };
    assert_eq!(bytes.len(), frames * VERTICES * 12, "{description}");
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

fn refused(error: &AnimationError) {
    let message = error.to_string();
    crate::check_message(&message, "some.frames");
    let expected = matches!(
        error,
        AnimationError::BadDescription { .. }
            | AnimationError::Camera { .. }
            | AnimationError::WrongSize { .. }
            | AnimationError::VertexCount { .. }
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
