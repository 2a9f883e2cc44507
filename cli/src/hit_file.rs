//! Files of hits: 16-byte records `t triangle u v`, or one byte a ray; .npy by the file's ending.
//!
//! All hits are two files. The one named holds the crossings of all rays, one ray after the other, in records of
//! 20 bytes `t triangle u v front`, `front` being 1 where the ray comes from the front and 0 elsewhere. The
//! other, with `.starts` before the ending, holds 64-bit numbers, one more than there are rays: where the
//! crossings of each ray begin, and behind the last one how many there are.
//!
//! Records of scenes of many objects have three words more: geometry, instance, and the user's number of the instance. All three are
//! 4294967295 where there is none.

use super::failure::Failure;
use super::{files, npy};
use splitplane::objects::{
    BakedTable, BuiltScene, InstanceId, SceneAllHits, SceneClosestPoint, SceneHit,
};
use splitplane::{AllHits, ClosestPoint, Hit, Located, Location, QueryError, Rule};
use std::path::{Path, PathBuf};

const HIT_TYPE: &str = "[('t', '<f4'), ('triangle', '<u4'), ('u', '<f4'), ('v', '<f4')]";
const CROSSING_TYPE: &str =
    "[('t', '<f4'), ('triangle', '<u4'), ('u', '<f4'), ('v', '<f4'), ('front', '<u4')]";
const CLOSEST_POINT_TYPE: &str = "[('distance', '<f4'), ('triangle', '<u4'), ('u', '<f4'), ('v', '<f4'), ('x', '<f4'), ('y', '<f4'), ('z', '<f4')]";

const SCENE_HIT_TYPE: &str = "[('t', '<f4'), ('triangle', '<u4'), ('u', '<f4'), ('v', '<f4'), ('geometry', '<u4'), ('instance', '<u4'), ('id', '<u4')]";
const SCENE_CROSSING_TYPE: &str = "[('t', '<f4'), ('triangle', '<u4'), ('u', '<f4'), ('v', '<f4'), ('front', '<u4'), ('geometry', '<u4'), ('instance', '<u4'), ('id', '<u4')]";
const SCENE_CLOSEST_POINT_TYPE: &str = "[('distance', '<f4'), ('triangle', '<u4'), ('u', '<f4'), ('v', '<f4'), ('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('geometry', '<u4'), ('instance', '<u4'), ('id', '<u4')]";

/// The answer of any hit for a ray that was left undecided.
const NO_ANSWER: u8 = 255;

/// Writes closest hits; a miss is `inf 4294967295 0 0`.
pub(super) fn write_closest(path: &Path, hits: &[Hit]) -> Result<(), Failure> {
    let mut bytes = start(path, HIT_TYPE, 16, hits.len())?;
    for hit in hits {
        let words = [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()];
        bytes.extend(words.into_iter().flat_map(u32::to_le_bytes));
    }
    files::write(path, &bytes)
}

/// Writes 1 for every ray that hits anything, 0 for the others; [`NO_ANSWER`] at the places in
/// `flagged`.
pub(super) fn write_any(path: &Path, hits: &[bool], flagged: &[usize]) -> Result<(), Failure> {
    let mut bytes = start(path, "'|u1'", 1, hits.len())?;
    let first = bytes.len();
    bytes.extend(hits.iter().map(|&hit| u8::from(hit)));
    for &place in flagged {
        bytes[first + place] = NO_ANSWER;
    }
    files::write(path, &bytes)
}

/// Writes all crossings of every ray; gives the names of both files, which appear together.
pub(super) fn write_all(path: &Path, all: &AllHits) -> Result<[PathBuf; 2], Failure> {
    let mut bytes = start(path, CROSSING_TYPE, 20, all.crossings.len())?;
    for met in &all.crossings {
        let Hit { t, triangle, u, v } = met.hit;
        let words = [t.to_bits(), triangle, u.to_bits(), v.to_bits(), u32::from(met.front)];
        bytes.extend(words.into_iter().flat_map(u32::to_le_bytes));
    }
    write_with_starts(path, &bytes, &all.starts)
}

/// Writes crossings, and beside them where those of each ray begin.
fn write_with_starts(path: &Path, bytes: &[u8], all: &[usize]) -> Result<[PathBuf; 2], Failure> {
    let beside = starts_beside(path);
    let mut starts = start(&beside, "'<u8'", 8, all.len())?;
    starts.extend(all.iter().flat_map(|start| (*start as u64).to_le_bytes()));
    files::write_together([(path.to_owned(), bytes), (beside.clone(), starts.as_slice())])?;
    Ok([path.to_owned(), beside])
}

/// A scene that is built, and what its triangles were in its file.
pub(super) struct Named<'a> {
    pub(super) scene: &'a BuiltScene,
    pub(super) table: &'a BakedTable,
}

impl Named<'_> {
    /// The triangle, its geometry, its instance, and the user's number of that: the file's.
    fn names(&self, triangle: u32, geometry: u32, instance: u32) -> (u32, [u32; 3]) {
        let placement = self.scene.placement(InstanceId(instance));
        let number = placement.map_or(u32::MAX, |placement| placement.instance.id);
        match self.table.original(InstanceId(instance), triangle) {
            Some((instance, geometry, triangle)) => (triangle, [geometry.0, instance.0, number]),
            None => (triangle, [geometry, instance, number]),
        }
    }
}

/// Writes closest hits with many objects; a miss is `inf 4294967295 0 0` and three times 4294967295.
pub(super) fn write_scene_closest(
    path: &Path,
    hits: &[SceneHit],
    scene: &Named<'_>,
) -> Result<(), Failure> {
    let mut bytes = start(path, SCENE_HIT_TYPE, 28, hits.len())?;
    for hit in hits {
        let (triangle, names) = scene.names(hit.triangle, hit.geometry, hit.instance);
        let words = [hit.t.to_bits(), triangle, hit.u.to_bits(), hit.v.to_bits()];
        bytes.extend(words.into_iter().chain(names).flat_map(u32::to_le_bytes));
    }
    files::write(path, &bytes)
}

/// Writes all crossings with many objects; gives the names of both files, which appear together.
pub(super) fn write_scene_all(
    path: &Path,
    all: &SceneAllHits,
    scene: &Named<'_>,
) -> Result<[PathBuf; 2], Failure> {
    let mut bytes = start(path, SCENE_CROSSING_TYPE, 32, all.crossings.len())?;
    for met in &all.crossings {
        let SceneHit { t, triangle, u, v, geometry, instance } = met.hit;
        let (triangle, names) = scene.names(triangle, geometry, instance);
        let words = [t.to_bits(), triangle, u.to_bits(), v.to_bits(), u32::from(met.front)];
        bytes.extend(words.into_iter().chain(names).flat_map(u32::to_le_bytes));
    }
    write_with_starts(path, &bytes, &all.starts)
}

/// Writes closest points of many objects; where there is none `inf 4294967295 0 0 0 0 0` and three times 4294967295.
pub(super) fn write_scene_closest_points(
    path: &Path,
    closest: &[SceneClosestPoint],
    signs: Option<&Located>,
    scene: &Named<'_>,
) -> Result<(), Failure> {
    let mut bytes = start(path, SCENE_CLOSEST_POINT_TYPE, 40, closest.len())?;
    for (place, closest) in closest.iter().enumerate() {
        let distance = signed(place, closest.distance(), closest.is_some(), signs);
        let SceneClosestPoint { point: [x, y, z], triangle, u, v, geometry, instance, .. } =
            *closest;
        let [x, y, z, u, v] = [x, y, z, u, v].map(f32::to_bits);
        let (triangle, names) = scene.names(triangle, geometry, instance);
        let words = [distance.to_bits(), triangle, u, v, x, y, z];
        bytes.extend(words.into_iter().chain(names).flat_map(u32::to_le_bytes));
    }
    files::write(path, &bytes)
}

/// A distance, negative for a point inside.
fn signed(place: usize, distance: f32, is_some: bool, signs: Option<&Located>) -> f32 {
    let is_inside = is_some
        && signs.is_some_and(|located| located.location(place, Rule::NonZero) == Location::Inside);
    if is_inside { -distance } else { distance }
}

/// `hits.npy` becomes `hits.starts.npy`.
pub(super) fn starts_beside(path: &Path) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(".starts");
    if let Some(ending) = path.extension() {
        name.push(".");
        name.push(ending);
    }
    path.with_file_name(name)
}

/// Writes 0 for every point outside, 1 for those inside, 2 for those on a triangle.
pub(super) fn write_inside(path: &Path, located: &Located) -> Result<(), Failure> {
    let mut bytes = start(path, "'|u1'", 1, located.windings.len())?;
    bytes.extend((0..located.windings.len()).map(|point| {
        match located.location(point, Rule::NonZero) {
            Location::Outside => 0,
            Location::Inside => 1,
            Location::Boundary => 2,
        }
    }));
    files::write(path, &bytes)
}

/// Writes closest points; where there is none `inf 4294967295 0 0 0 0 0`. With `signs` the distances of points inside are negative.
pub(super) fn write_closest_points(
    path: &Path,
    closest: &[ClosestPoint],
    signs: Option<&Located>,
) -> Result<(), Failure> {
    let mut bytes = start(path, CLOSEST_POINT_TYPE, 28, closest.len())?;
    for (place, closest) in closest.iter().enumerate() {
        let distance = signed(place, closest.distance(), closest.is_some(), signs);
        let ClosestPoint { point: [x, y, z], triangle, u, v, .. } = *closest;
        let [x, y, z, u, v] = [x, y, z, u, v].map(f32::to_bits);
        let words = [distance.to_bits(), triangle, u, v, x, y, z];
        bytes.extend(words.into_iter().flat_map(u32::to_le_bytes));
    }
    files::write(path, &bytes)
}

/// The head of a file, and room for so many records of so many bytes behind it.
pub(super) fn start(
    path: &Path,
    kind: &str,
    size: usize,
    count: usize,
) -> Result<Vec<u8>, Failure> {
    let mut bytes = match path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npy"))
    {
        true => npy::header(kind, count),
        false => Vec::new(),
    };
    let needed = bytes.len() as u64 + size as u64 * count as u64;
    let refused = |_| QueryError::OutOfMemory { needed, limit: needed };
    bytes.try_reserve_exact(size * count).map_err(refused)?;
    Ok(bytes)
}
