//! Tree files: what is written is read back in place, and whatever is done to the bytes ends in a
//! typed error.

use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::tree::digest::Xxh64;
use splitplane_core::tree::file::{FileError, TreeFile, VERSION, mesh_digest, write};
use splitplane_core::tree::validate::{validate, validate_mesh};
use splitplane_core::tree::{KdTree, KdTreeView};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::exact::ExactBackend;
use splitplane_test_support::forge::{self, Forgery, forge};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use std::collections::BTreeMap;

/// The bytes of a tree file, at an address divisible by four.
struct Bytes(Vec<u32>, usize);

impl Bytes {
    fn of(bytes: &[u8]) -> Bytes {
        let words = bytes
            .chunks(4)
            .map(|chunk| {
                let mut word = [0; 4];
                word[..chunk.len()].copy_from_slice(chunk);
                u32::from_le_bytes(word)
            })
            .collect();
        Bytes(words, bytes.len())
    }

    fn get(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> = self.0.iter().flat_map(|word| word.to_le_bytes()).collect();
        bytes.truncate(self.1);
        bytes
    }
}

fn tree_of(positions: &[[f32; 3]], indices: &[[u32; 3]]) -> (KdTree, Vec<u8>) {
    let mesh = Mesh::indexed(positions, indices).unwrap();
    let (tree, _) = CpuBackend::new().build_tree(&mesh, &BuildOptions::default()).unwrap();
    let bytes = write(&tree.view(), &mesh).expect("memory");
    (tree, bytes)
}

fn sample() -> (KdTree, Vec<u8>) {
    let scene = scenes::soup(300, 0.2, 3);
    let mesh = scene.mesh();
    let triangles: Vec<[[f32; 3]; 3]> = (0..mesh.len()).map(|i| mesh.triangle(i)).collect();
    let positions: Vec<[f32; 3]> = triangles.as_flattened().to_vec();
    let indices: Vec<[u32; 3]> =
        (0..mesh.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    tree_of(&positions, &indices)
}

/// Parses a copy of the bytes that starts at a multiple of four.
fn parse(bytes: &[u8]) -> Result<(), FileError> {
    let aligned = Bytes::of(bytes);
    let whole = aligned.get();
    assert_eq!(whole, bytes);
    // Parsed from the words themselves, which are aligned.
    let view: &[u8] = bytemuck_cast(&aligned.0);
    TreeFile::parse(&view[..bytes.len()]).map(|_| ())
}

fn bytemuck_cast(words: &[u32]) -> &[u8] {
    bytemuck::cast_slice(words)
}

#[test]
fn what_is_written_is_read_back() {
    let (tree, bytes) = sample();
    let aligned = Bytes::of(&bytes);
    let view = bytemuck_cast(&aligned.0);
    let file = TreeFile::parse(&view[..bytes.len()]).unwrap();
    assert_eq!(file.tree.to_tree().expect("memory"), tree);
    assert_eq!(file.tree.digest(), tree.digest());
    // In place: the nodes lie within the bytes.
    let range = view.as_ptr_range();
    assert!(range.contains(&file.tree.nodes.as_ptr().cast()));
}

#[test]
fn an_empty_tree_is_a_file_too() {
    let (tree, bytes) = tree_of(&[], &[]);
    assert_eq!(tree.nodes.len(), 1);
    assert_eq!(parse(&bytes), Ok(()));
}

#[test]
fn the_mesh_is_named() {
    let one = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
    let mut other = one;
    other[0][2][1] = 1.0f32.next_up();
    let digest = |t: &[[[f32; 3]; 3]]| mesh_digest(&Mesh::soup(t).unwrap());
    assert_ne!(digest(&one), digest(&other));
}

#[test]
fn every_cut_is_an_error() {
    let (_, bytes) = sample();
    for length in (0..bytes.len()).step_by(7).chain(bytes.len() - 9..bytes.len()) {
        let error = parse(&bytes[..length]).unwrap_err();
        assert!(matches!(error, FileError::Magic | FileError::Length { .. }), "{length}: {error}");
    }
    let mut long = bytes.clone();
    long.push(0);
    assert!(matches!(parse(&long), Err(FileError::Length { .. })));
}

#[test]
fn every_flipped_bit_is_an_error() {
    let (_, bytes) = sample();
    for at in 0..bytes.len() {
        let mut altered = bytes.clone();
        altered[at] ^= 1 << (at % 8);
        assert!(parse(&altered).is_err(), "byte {at}");
    }
}

#[test]
fn other_versions_and_other_files_are_told_apart() {
    let (_, bytes) = sample();
    let mut newer = bytes.clone();
    newer[8..12].copy_from_slice(&(VERSION + 1).to_le_bytes());
    assert_eq!(parse(&newer), Err(FileError::Version { found: VERSION + 1 }));
    assert_eq!(parse(b"v 0 0 0\nf 1 1 1\n and more than that"), Err(FileError::Magic));
    let aligned = Bytes::of(&[&[0], &bytes[..]].concat());
    let view = bytemuck_cast(&aligned.0);
    assert_eq!(TreeFile::parse(&view[1..=bytes.len()]).map(|_| ()), Err(FileError::Alignment));
}

/// A liar: the checksum is right, the tree is not.
#[test]
fn a_checksum_does_not_make_a_tree() {
    let (mut tree, _) = sample();
    let scene = scenes::soup(300, 0.2, 3);
    let reference = tree.references.len() / 2;
    tree.references[reference] = 100_000;
    assert!(validate(&tree.view()).is_err());
    let bytes = write(&tree.view(), &scene.mesh()).expect("memory");
    assert!(matches!(parse(&bytes), Err(FileError::Tree(_))));
}

/// The checksum is right and so is the tree, but its digest is another's.
#[test]
fn a_digest_of_another_tree_is_refused() {
    let (_, bytes) = sample();
    for at in 88..96 {
        let mut altered = bytes.clone();
        altered[at] ^= 1;
        let mut state = Xxh64::new(u64::from(VERSION));
        state.write(&altered[..120]);
        state.write(&altered[128..]);
        altered[120..128].copy_from_slice(&state.finish().to_le_bytes());
        assert_eq!(parse(&altered), Err(FileError::Digest), "byte {at}");
    }
}

/// Scenes with all that a tree can lose: triangles in planes, segments, edges and corners that touch.
fn forged_scenes() -> Vec<Scene> {
    let segments = (0..6usize).flat_map(|i| {
        let x = i as f32 * 0.5;
        let end = [[x, 3.0, 3.0], [x + 3.0, 1.0, 0.5], [3.0 - x, 3.0, x]][i % 3];
        [[x, 0.0, 0.5], [0, 1, 2].map(|k| 0.5 * [x, 0.0, 0.5][k] + 0.5 * end[k]), end]
    });
    let segments = Scene { name: "segments".into(), positions: segments.collect(), indices: None };
    vec![
        scenes::grid_boxes(1).joined(&scenes::soup(12, 0.5, 4), "a box and a soup"),
        scenes::grid_boxes(2),
        scenes::coplanar(1, 30),
        scenes::stairs(4),
        scenes::soup(25, 0.4, 6),
        scenes::seams(true),
        segments.joined(&scenes::soup(6, 0.5, 9), "segments in a soup"),
    ]
}

/// All answers of a tree, by the reference traversal: closest hits, any hits, all crossings.
fn answers(tree: &KdTreeView<'_>, mesh: &Mesh<'_>, rays: &[Ray]) -> (Vec<Hit>, Vec<bool>, AllHits) {
    let options = exact();
    let trace = |ray: &Ray, query| {
        splitplane_core::query::traverse::exact::trace(tree, mesh, ray, &options, query, &mut ())
    };
    let closest = rays.iter().map(|ray| trace(ray, Query::Closest)).collect();
    let any = rays.iter().map(|ray| trace(ray, Query::Any).is_hit()).collect();
    (
        closest,
        any,
        AllHits::one_by_one(tree, mesh, rays, &AllHitsOptions::default()).expect("memory"),
    )
}

fn exact() -> QueryOptions<'static> {
    QueryOptions { accuracy: Accuracy::Exact, ..Default::default() }
}

/// Whatever a forger does to a tree, with digest and checksum to match: it is refused, or it answers
/// every ray as a leaf with all triangles does.
#[test]
fn a_forged_tree_is_refused_or_answers_rightly() {
    let backend = CpuBackend::new();
    let mut random = Random::new(7);
    // By forgery: how often it was refused, and how often it made no difference.
    let mut seen: BTreeMap<Forgery, [usize; 2]> = BTreeMap::new();
    for scene in forged_scenes() {
        let mesh = scene.mesh();
        for preset in Preset::ALL {
            let mut config =
                BuildConfig { block_width: 1, intersection_cost: 3, ..preset.config() };
            if let Some(stages) = config.stages_mut() {
                stages.small_node_limit = 4;
            }
            let options = BuildOptions::from(config);
            let (honest, _) = backend.build_tree(&mesh, &options).unwrap();
            let leaf = ExactBackend.build(&mesh, &options).unwrap();
            let common: Vec<Ray> = Kind::ALL
                .into_iter()
                .flat_map(|kind| aim::rays(&mesh, kind, 10, 9))
                .chain(forge::rays(&honest.view(), None, &mesh, 1))
                .collect();
            let expected = answers(&leaf.tree().view(), &mesh, &common);
            assert!(expected.0.iter().any(Hit::is_hit));
            assert!(answers(&honest.view(), &mesh, &common) == expected, "{}", scene.name);
            for round in 0..Forgery::ALL.len() * 12 {
                let forgery = Forgery::ALL[round % Forgery::ALL.len()];
                let mut forged = honest.clone();
                // One alteration, or one upon another.
                let mut done = forge(&mut forged, &mesh, forgery, &mut |n| random.below(n));
                if round % 4 == 0 {
                    let other = random.pick(&Forgery::ALL);
                    done |= forge(&mut forged, &mesh, other, &mut |n| random.below(n));
                }
                if !done || forged == honest {
                    continue;
                }
                let bytes = write(&forged.view(), &mesh).expect("memory");
                let aligned = Bytes::of(&bytes);
                let parsed = TreeFile::parse(&bytemuck_cast(&aligned.0)[..bytes.len()]);
                let count = seen.entry(forgery).or_default();
                let Ok(file) = parsed else {
                    count[0] += 1;
                    continue;
                };
                assert_eq!(file.mesh, mesh_digest(&mesh));
                let violation = validate_mesh(&file.tree, &mesh);
                let loaded = match backend.load(&mesh, forged.clone(), &options.for_loading()) {
                    Err(BuildError::WrongMesh { reason }) => {
                        assert_eq!(Err(reason), violation.map_err(|v| v.to_string()));
                        count[0] += 1;
                        continue;
                    }
                    loaded => loaded.unwrap(),
                };
                assert_eq!(violation, Ok(()));
                count[1] += 1;
                let what = || format!("{}, {preset:?}, {forgery:?}: {forged:?}", scene.name);
                let before = honest.view();
                let rays = forge::rays(&forged.view(), Some(&before), &mesh, round as u64);
                let more = answers(&leaf.tree().view(), &mesh, &rays);
                for (rays, expected) in [(&common, &expected), (&rays, &more)] {
                    assert!(answers(&forged.view(), &mesh, rays) == *expected, "{}", what());
                    let mut hits = vec![Hit::MISS; rays.len()];
                    loaded.closest_hits(rays, &mut hits, &exact()).unwrap();
                    assert!(hits == expected.0, "{}", what());
                }
            }
        }
    }
    for forgery in Forgery::ALL {
        let [refused, accepted] = seen[&forgery];
        // Nothing is lost in wider bounds. Bounds are as tight as can be, and order is looked at.
        assert!(refused > 9 || forgery == Forgery::WidensBounds, "{forgery:?}: {seen:?}");
        let never = [Forgery::ShrinksBounds, Forgery::Disorders].contains(&forgery);
        assert!(accepted > 1 || never, "{forgery:?}: {seen:?}");
    }
}
