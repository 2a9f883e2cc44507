//! Scene files: any bytes, and good files altered so that lengths and checksum still fit.

use crate::source::Source;
use bytemuck::cast_slice;
use splitplane_core::backend::scene::write_file;
use splitplane_core::backend::{Backend, BuildOptions, LoadOptions};
use splitplane_core::config::Preset;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::scene::file::{MAGIC, SceneFile, SceneFileError, VERSION};
use splitplane_core::scene::shape::{Capsule, Shapes, Sphere};
use splitplane_core::scene::{Instance, OpacityMask, Scene, SceneHit, SceneOptions, translation};
use splitplane_core::tree::digest::Xxh64;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::scenes;

/// Words of the head.
const HEAD: usize = 16;
/// The word where the checksum stands.
const CHECKSUM: usize = 14;

/// A good file, and rays for its scene.
struct Sample {
    words: Vec<u32>,
    rays: Vec<Ray>,
    hits: Vec<SceneHit>,
}

thread_local! {
    static SAMPLES: Vec<Sample> = samples();
    static BACKEND: CpuBackend = CpuBackend::new();
}

fn samples() -> Vec<Sample> {
    let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.5]];
    let indexed = Mesh::indexed(&positions, &[[0, 1, 2], [2, 1, 3]]).expect("a mesh");
    let mut with_gaps = Scene::new();
    let one = with_gaps.add_mesh(&scenes::one().mesh()).expect("a geometry");
    let gone = with_gaps.add_mesh(&scenes::none().mesh()).expect("a geometry");
    let two = with_gaps.add_mesh(&indexed).expect("a geometry");
    let names: Vec<_> = [one, two, one, two]
        .into_iter()
        .zip(0u16..)
        .map(|(geometry, place)| {
            let transform = translation([f32::from(place), 0.5, 0.0]);
            with_gaps.add_instance(Instance::new(geometry, transform)).expect("an instance")
        })
        .collect();
    let mask = OpacityMask::new(2, 1, |_, [u, _]| u > 0.4).expect("a mask");
    with_gaps.set_opacity(two, Some(mask)).expect("as many triangles");
    let sphere = Sphere { centre: [0.5, 0.5, 1.0], radius: 0.75 };
    let capsule = Capsule { ends: [[2.0, 0.5, 0.0], [2.5, 1.0, 0.5]], radius: 0.25 };
    for shapes in [Shapes::Spheres(vec![sphere]), Shapes::Capsules(vec![capsule])] {
        let shapes = with_gaps.add_shapes(shapes).expect("a geometry");
        with_gaps.add_instance(Instance::in_place(shapes)).expect("an instance");
    }
    with_gaps.remove_instance(names[1]).expect("it is there");
    with_gaps.remove_geometry(gone).expect("nobody uses it");
    let backend = CpuBackend::new();
    [with_gaps, objects::scene(Kind::Ordinary, 6, 2).0]
        .iter()
        .zip([Preset::Fast, Preset::Best])
        .map(|(scene, preset)| {
            let built = backend.build_scene(scene, &BuildOptions::from(preset)).expect("a scene");
            let bytes = write_file(built.scene()).expect("memory");
            let rays = objects::rays(scene, 20, 3);
            let mut hits = vec![SceneHit::MISS; rays.len()];
            let traced = built.closest_hits(&rays, &mut hits, &SceneOptions::default());
            traced.expect("lengths are equal");
            Sample { words: words_of(&bytes), rays, hits }
        })
        .collect()
}

/// Bytes at an address that is a multiple of four; what is missing of the last word is zero.
fn words_of(bytes: &[u8]) -> Vec<u32> {
    let word = |chunk: &[u8]| {
        let mut word = [0; 4];
        word[..chunk.len()].copy_from_slice(chunk);
        u32::from_ne_bytes(word)
    };
    bytes.chunks(4).map(word).collect()
}

fn parse(bytes: &[u8]) -> Result<SceneFile<'_>, SceneFileError> {
    let parsed = SceneFile::parse(bytes);
    if let Err(error) = &parsed {
        crate::check_message(&error.to_string(), "");
    }
    parsed
}

/// Bytes as a scene file. Whatever is read as a scene must load as one or be refused, and what its digest names as the
/// sample must answer as that.
pub fn run(data: &[u8]) {
    crate::single_thread();
    let mut source = Source::new(data);
    SAMPLES.with(|samples| {
        let sample = &samples[source.below(samples.len())];
        if source.once_in(8) {
            let mut bytes = if source.once_in(2) { MAGIC.to_vec() } else { Vec::new() };
            bytes.extend(source.rest());
            let words = words_of(&bytes);
            assert!(parse(&cast_slice(&words)[..bytes.len()]).is_err(), "a scene of chance");
        } else {
            altered(&mut source, sample);
        }
    });
}

fn altered(source: &mut Source<'_>, sample: &Sample) {
    let mut words = sample.words.clone();
    for _ in 0..source.below(4) {
        alter(source, &mut words);
    }
    if words.len() >= HEAD && !source.once_in(8) {
        seal(&mut words);
    }
    let length =
        if source.once_in(8) { source.below(4 * words.len() + 1) } else { 4 * words.len() };
    let Ok(file) = parse(&cast_slice(&words)[..length]) else {
        assert!(words != sample.words || length < 4 * words.len(), "a good file is refused");
        return;
    };
    let loaded = BACKEND.with(|backend| backend.load_scene(&file, &LoadOptions::default()));
    let (scene, loaded) = match loaded {
        Ok(loaded) => loaded,
        Err(error) => return crate::check_message(&error.to_string(), "geometry"),
    };
    assert_eq!(loaded.scene().digest(), file.digest());
    assert_eq!(scene.len(), file.instances().count());
    let mut hits = vec![SceneHit::MISS; sample.rays.len()];
    let traced = loaded.closest_hits(&sample.rays, &mut hits, &SceneOptions::default());
    traced.expect("lengths are equal");
    // Only the counts of names are not named by the digest.
    assert!(hits == sample.hits, "another scene of the same digest");
    let again = write_file(loaded.scene()).expect("memory");
    assert!(parse(cast_slice(&words_of(&again))).is_ok());
}

/// One change: of the head, of a record, of any word, or of how many there are.
fn alter(source: &mut Source<'_>, words: &mut Vec<u32>) {
    let at = match source.below(4) {
        0 => source.below(HEAD),
        1 => HEAD + source.below(64),
        2 => {
            // A word more or less, and a head that knows of it.
            let at = HEAD + source.below(words.len() - HEAD);
            if source.once_in(2) {
                words.insert(at, source.bits());
            } else if words.len() > HEAD + 1 {
                words.remove(at);
            }
            words[8] = 4 * words.len() as u32;
            return;
        }
        _ => source.below(words.len()),
    };
    let Some(word) = words.get_mut(at) else { return };
    *word = match source.below(6) {
        0 => source.number().to_bits(),
        1 => word.wrapping_add(1),
        2 => word.wrapping_sub(1),
        3 => *word ^ 1 << source.below(32),
        4 => source.count(),
        _ => source.bits(),
    };
}

/// Writes the checksum.
fn seal(words: &mut [u32]) {
    let bytes: &[u8] = cast_slice(words);
    let mut state = Xxh64::new(u64::from(VERSION));
    state.write(&bytes[..4 * CHECKSUM]);
    state.write(&bytes[4 * HEAD..]);
    let sum = state.finish();
    (words[CHECKSUM], words[CHECKSUM + 1]) = (sum as u32, (sum >> 32) as u32);
}
