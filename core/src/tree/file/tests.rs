use alloc::vec::Vec;

use super::*;
use crate::config::Preset;
use crate::tree::node::{Axis, KdNode};

const QUAD: [[[f32; 3]; 3]; 2] = [
    [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.5]],
    [[0.0, 0.0, 0.0], [2.0, 1.0, 0.5], [0.0, 1.0, 0.25]],
];
const NODES: [KdNode; 3] =
    [KdNode::interior(Axis::X, 1.0, 2), KdNode::leaf(0, 2), KdNode::leaf(2, 2)];
const REFERENCES: [u32; 4] = [0, 1, 0, 1];

fn tree() -> KdTreeView<'static> {
    KdTreeView {
        nodes: &NODES,
        references: &REFERENCES,
        bounds: Aabb { lo: [0.0; 3], hi: [2.0, 1.0, 0.5] },
        triangles: 2,
        config: Preset::Balanced.config(),
    }
}

/// The file as its format says, put together from words. (Where the bytes begin in memory they are aligned.)
fn words() -> Vec<u32> {
    let tree = tree();
    let halves = |long: u64| [long as u32, (long >> 32) as u32];
    let config = tree.config.words();
    let mut hash = Xxh64::new(1);
    QUAD.as_flattened().as_flattened().iter().for_each(|x| hash.write(&x.to_le_bytes()));
    let mut words =
        Vec::from([u32::from_le_bytes(*b"spli"), u32::from_le_bytes(*b"tkd\n"), 1, 128]);
    words.extend(&config[..9]);
    words.push(2);
    words.extend([0.0f32, 0.0, 0.0, 2.0, 1.0, 0.5].map(f32::to_bits));
    words.extend([3, 4]);
    words.extend(halves(tree.digest().0));
    words.extend(halves(hash.finish()));
    words.extend(&config[9..]);
    words.extend([0; 2]);
    words.extend([1.0f32.to_bits(), 2 << 2, 0, 2 << 2 | 3, 2, 2 << 2 | 3]);
    words.extend(REFERENCES);
    seal(&mut words);
    words
}

/// Makes the checksum right.
fn seal(words: &mut [u32]) {
    let mut hash = Xxh64::new(1);
    hash.write_words(&words[..30]);
    hash.write_words(&words[32..]);
    let sum = hash.finish();
    (words[30], words[31]) = (sum as u32, (sum >> 32) as u32);
}

fn parse(words: &[u32]) -> Result<TreeFile<'_>, FileError> {
    TreeFile::parse(bytemuck::cast_slice(words))
}

#[test]
fn files_are_as_the_format_says() {
    let words = words();
    let bytes = write(&tree(), &Mesh::soup(&QUAD).expect("a mesh")).expect("memory");
    assert_eq!(bytes, bytemuck::cast_slice::<u32, u8>(&words));
    let file = parse(&words).expect("a file");
    assert_eq!(file.tree, tree());
    assert_eq!(file.mesh, mesh_digest(&Mesh::soup(&QUAD).expect("a mesh")));
    // Without nodes and references there is no tree, but the header is long enough to say so.
    let mut head = words[..32].to_vec();
    (head[20], head[21]) = (0, 0);
    seal(&mut head);
    assert!(matches!(parse(&head), Err(FileError::Tree(_))), "{:?}", parse(&head));
}

#[test]
fn files_cut_or_extended_tell_their_length() {
    let mut words = words();
    let length = words.len();
    let whole: &[u8] = bytemuck::cast_slice(&words);
    for cut in 0..whole.len() {
        let expected = match cut {
            0..8 => FileError::Magic,
            8..128 => FileError::Length { found: cut as u64, expected: 128 },
            _ => FileError::Length { found: cut as u64, expected: whole.len() as u64 },
        };
        assert_eq!(TreeFile::parse(&whole[..cut]), Err(expected), "{cut}");
    }
    let expected = FileError::Length { found: 4 * length as u64 + 4, expected: 4 * length as u64 };
    words.push(0);
    assert_eq!(parse(&words), Err(expected));
}

#[test]
fn every_word_counts() {
    let good = words();
    for place in 0..good.len() {
        for bit in [0, 13, 31] {
            let mut bad = good.clone();
            bad[place] ^= 1 << bit;
            let error = parse(&bad).expect_err("an altered file");
            match place {
                0 | 1 => assert_eq!(error, FileError::Magic),
                2 => assert_eq!(error, FileError::Version { found: bad[2] }),
                3 => assert!(matches!(error, FileError::Length { .. })),
                20 | 21 => {
                    let expected = 128 + 8 * u64::from(bad[20]) + 4 * u64::from(bad[21]);
                    assert_eq!(error, FileError::Length { found: 168, expected });
                }
                _ => assert_eq!(error, FileError::Checksum, "{place}"),
            }
        }
    }
}

/// With a corrected checksum, everything except the mesh's digest is still checked.
#[test]
fn forged_files_are_refused() {
    let good = words();
    for place in (4..good.len()).filter(|place| !matches!(place, 20..22 | 24..26 | 30..32)) {
        let mut bad = good.clone();
        bad[place] ^= 1 << 3;
        seal(&mut bad);
        let error = parse(&bad).expect_err("a forged file");
        let expected = match place {
            4..13 | 26..30 => matches!(error, FileError::Config | FileError::Digest),
            22..24 => error == FileError::Digest,
            _ => matches!(error, FileError::Tree(_) | FileError::Digest),
        };
        assert!(expected, "{place}: {error:?}");
    }
    let mut other_mesh = good;
    other_mesh[24] ^= 1;
    other_mesh[25] ^= 1;
    seal(&mut other_mesh);
    let file = parse(&other_mesh).expect("a file of another mesh");
    let digest = mesh_digest(&Mesh::soup(&QUAD).expect("a mesh")).0;
    assert_eq!(file.mesh, Digest(digest ^ (1 << 32 | 1)));
}

#[test]
fn bytes_must_be_aligned() {
    let words = words();
    let mut bytes = Vec::from([0u8; 4]);
    bytes.extend(bytemuck::cast_slice::<u32, u8>(&words));
    let start = (0..4).find(|start| !bytes[*start..].as_ptr().addr().is_multiple_of(4));
    let start = start.expect("one of two that follow each other");
    bytes.rotate_left(4 - start);
    assert_eq!(TreeFile::parse(&bytes[start..][..4 * words.len()]), Err(FileError::Alignment));
}

/// A file is made at once, in no more memory than it has bytes.
#[test]
fn files_take_their_own_length() {
    let references: Vec<u32> = (0..1000).collect();
    let nodes = [KdNode::leaf(0, 1000)];
    let tree = KdTreeView { nodes: &nodes, references: &references, triangles: 1000, ..tree() };
    let bytes = write(&tree, &Mesh::soup(&QUAD).expect("a mesh")).expect("memory");
    assert_eq!(bytes.len(), 128 + 8 + 4 * 1000);
    assert_eq!(bytes.capacity(), bytes.len());
}
