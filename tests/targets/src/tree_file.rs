//! Tree files: any bytes, and good files altered so that lengths, checksum and digest still fit.

use crate::source::Source;
use bytemuck::cast_slice;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::BuildError;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::tree::digest::Xxh64;
use splitplane_core::tree::file::{FileError, TreeFile};
use splitplane_core::tree::stats::TreeStats;
use splitplane_core::tree::{KdTree, KdTreeView, file};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::forge::{Forgery, forge};
use splitplane_test_support::judge::Judge;
use splitplane_test_support::oracle::Oracle;
use splitplane_test_support::scenes::{self, Scene};

/// Bytes of the head.
const HEAD: usize = 128;
/// Where the checksum stands.
const CHECKSUM: usize = 120;

/// A mesh, and a good file over it.
struct Sample {
    scene: Scene,
    words: Vec<u32>,
    oracle: Oracle,
    rays: Vec<Ray>,
}

thread_local! {
    static SAMPLES: Vec<Sample> = samples();
    static BACKEND: CpuBackend = CpuBackend::new();
}

fn samples() -> Vec<Sample> {
    let small = |preset: Preset| {
        let mut config = BuildConfig { block_width: 1, intersection_cost: 3, ..preset.config() };
        if let Some(stages) = config.stages_mut() {
            stages.small_node_limit = 4;
        }
        config
    };
    let scenes = [
        (scenes::one(), Preset::Fast),
        (scenes::soup(20, 0.3, 3), Preset::Fast),
        (scenes::grid_boxes(1), Preset::Balanced),
        (scenes::soup(40, 0.2, 5), Preset::Best),
        (scenes::none(), Preset::Balanced),
    ];
    scenes
        .into_iter()
        .map(|(scene, preset)| {
            let mesh = scene.mesh();
            let options = BuildOptions::from(small(preset));
            let (tree, _) = CpuBackend::new().build_tree(&mesh, &options).expect("a tree");
            let bytes = file::write(&tree.view(), &mesh).expect("memory");
            let rays = [Kind::Faces, Kind::Vertices, Kind::AxisParallel]
                .into_iter()
                .flat_map(|kind| aim::rays(&mesh, kind, 4, 9))
                .collect();
            let oracle = Oracle::new(&mesh);
            Sample { words: words_of(&bytes), oracle, rays, scene }
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

/// Bytes as a tree file. Whatever is read as a tree must serve as one, and over its mesh answer
/// rightly.
pub fn run(data: &[u8]) {
    crate::single_thread();
    let mut source = Source::new(data);
    SAMPLES.with(|samples| {
        let sample = &samples[source.below(samples.len())];
        if source.once_in(8) {
            // Any bytes, after the magic ones or without them.
            let mut bytes = if source.once_in(2) { file::MAGIC.to_vec() } else { Vec::new() };
            bytes.extend(source.rest());
            let words = words_of(&bytes);
            assert!(parse(&cast_slice(&words)[..bytes.len()]).is_err(), "a tree of chance");
        } else {
            altered(&mut source, sample);
        }
    });
}

fn parse(bytes: &[u8]) -> Result<TreeFile<'_>, FileError> {
    let parsed = TreeFile::parse(bytes);
    if let Err(error) = &parsed {
        crate::check_message(&error.to_string(), "");
    }
    parsed
}

fn altered(source: &mut Source<'_>, sample: &Sample) {
    let mut words = sample.words.clone();
    let changes = source.below(6);
    for _ in 0..changes {
        alter(source, &mut words);
    }
    let length = match source.below(8) {
        7 => source.below(4 * words.len() + 1),
        6 => return forged(source, sample),
        _ => 4 * words.len(),
    };
    if words.len() >= HEAD / 4 && !source.once_in(8) {
        let seal = source.below(3);
        if seal > 0 {
            repair_digest(&mut words);
        }
        repair_checksum(&mut words);
    }
    let bytes: &[u8] = &cast_slice(&words)[..length];
    let Ok(file) = parse(bytes) else {
        assert!(changes > 0 || length < 4 * words.len(), "a good file is refused");
        return;
    };
    use_tree(&file.tree.to_tree().expect("memory"), sample);
}

/// A tree that keeps the form of one, in a file that is right in itself.
fn forged(source: &mut Source<'_>, sample: &Sample) {
    let mesh = sample.scene.mesh();
    let file = parse(cast_slice(&sample.words)).expect("a good file");
    let mut tree = file.tree.to_tree().expect("memory");
    for _ in 0..=source.below(3) {
        let forgery = Forgery::ALL[source.below(Forgery::ALL.len())];
        forge(&mut tree, &mesh, forgery, &mut |n| source.below(n));
    }
    let words = words_of(&file::write(&tree.view(), &mesh).expect("memory"));
    if let Ok(file) = parse(cast_slice(&words)) {
        use_tree(&file.tree.to_tree().expect("memory"), sample);
    }
}

/// One change: of the head, of a node, of a reference, of any word, or of how many there are.
fn alter(source: &mut Source<'_>, words: &mut Vec<u32>) {
    if words.len() < HEAD / 4 {
        return;
    }
    let (nodes, references) = (words[20] as usize, words[21] as usize);
    let first = HEAD / 4;
    let at = match source.below(8) {
        // Bounds.
        0 => {
            words[14 + source.below(6)] = source.number().to_bits();
            return;
        }
        // The rest of the head.
        1 => source.below(HEAD / 4),
        2 | 3 if nodes > 0 => first + source.below(2 * nodes),
        4 if references > 0 => first + 2 * nodes + source.below(references),
        // Another number of nodes or references, with as many words.
        5 => {
            let at = source.below(words.len() - first + 1) + first;
            words.insert(at, 0);
            if source.once_in(2) {
                words.insert(at, 3);
                words[20] = words[20].wrapping_add(1);
            } else {
                words[21] = words[21].wrapping_add(1);
            }
            return;
        }
        6 if words.len() > first && references > 0 => {
            words.pop();
            words[21] -= 1;
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

/// Writes the digest of whatever tree the words are, where they are long enough to be one.
fn repair_digest(words: &mut [u32]) {
    let (nodes, references) = (words[20] as usize, words[21] as usize);
    if words.len() != HEAD / 4 + 2 * nodes + references {
        return;
    }
    let config_word = |i: usize| words[if i < 9 { 4 + i } else { 26 + i - 9 }];
    // Where this is none, the file is refused before its digest is looked at.
    let Some(config) = BuildConfig::from_words(core::array::from_fn(config_word)) else { return };
    let corner = |at: usize| [0, 1, 2].map(|axis| f32::from_bits(words[at + axis]));
    let (node_words, references) = words[HEAD / 4..].split_at(2 * nodes);
    let digest = KdTreeView {
        nodes: cast_slice(node_words),
        references,
        bounds: Aabb { lo: corner(14), hi: corner(17) },
        triangles: words[13],
        config,
    }
    .digest()
    .0;
    (words[22], words[23]) = (digest as u32, (digest >> 32) as u32);
}

fn repair_checksum(words: &mut [u32]) {
    let bytes: &[u8] = cast_slice(words);
    let mut state = Xxh64::new(u64::from(file::VERSION));
    state.write(&bytes[..CHECKSUM]);
    state.write(&bytes[HEAD..]);
    let sum = state.finish();
    (words[30], words[31]) = (sum as u32, (sum >> 32) as u32);
}

/// A tree that passed all checks: measured, loaded over the mesh, and asked.
fn use_tree(tree: &KdTree, sample: &Sample) {
    let view = tree.view();
    let stats = TreeStats::of(&view);
    assert_eq!(stats.interior + stats.leaves, tree.nodes.len());
    let mesh = sample.scene.mesh();
    let again = file::write(&view, &mesh).expect("memory");
    let words = words_of(&again);
    let file = TreeFile::parse(cast_slice(&words)).expect("what is written can be read");
    assert_eq!(file.tree.digest(), tree.digest());
    let options = BuildOptions::from(tree.config);
    let loaded = BACKEND.with(|backend| backend.load(&mesh, tree.clone(), &options.for_loading()));
    match loaded {
        Ok(accelerator) => ask(accelerator.as_ref(), sample),
        Err(error @ BuildError::WrongMesh { .. }) => {
            crate::check_message(&error.to_string(), "mesh");
        }
        Err(other) => panic!("{other}"),
    }
}

fn ask(accelerator: &dyn Accelerator, sample: &Sample) {
    let mesh = sample.scene.mesh();
    let judge = Judge::new(&mesh, &sample.oracle);
    let options = QueryOptions::default();
    let mut hits = vec![Hit::MISS; sample.rays.len()];
    accelerator.closest_hits(&sample.rays, &mut hits, &options).expect("lengths are equal");
    for (ray, hit) in sample.rays.iter().zip(hits) {
        assert_eq!(accelerator.closest_hit(ray, &options), hit.some());
        if let Err(wrong) = judge.closest(ray, &options, hit.some()) {
            panic!("{wrong}");
        }
    }
}
