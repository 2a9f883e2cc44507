//! Tree files: what is written is read back in place, and whatever is done to the bytes ends in a
//! typed error.

use splitplane_core::backend::BuildOptions;
use splitplane_core::file::{FileError, TreeFile, VERSION, mesh_digest, write};
use splitplane_core::mesh::Mesh;
use splitplane_core::tree::KdTree;
use splitplane_core::validate::validate;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::scenes;

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
    let bytes = write(&tree.view(), &mesh);
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
    assert_eq!(KdTree::from(file.tree), tree);
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
    let bytes = write(&tree.view(), &scene.mesh());
    assert!(matches!(parse(&bytes), Err(FileError::Tree(_))));
}
