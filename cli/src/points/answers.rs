//! What is asked of a cloud, written to files.

use super::planes::Plane;
use super::report::{Found, Nearest, Outliers, Thinned};
use super::work::{Work, room};
use crate::failure::Failure;
use crate::hit_file::{start, starts_beside};
use crate::{cloud, ending, files, progress};
use splitplane::QueryError;
use splitplane::points::{KeptBytes, NearestOptions, Neighbour};
use std::path::{Path, PathBuf};

const NEIGHBOUR: &str = "[('distance', '<f4'), ('point', '<u4')]";
const PLANE: &str = "[('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('variation', '<f4')]";
/// Points between two looks at whether the run is to end.
const FEW: usize = 1024;

fn record(near: &Neighbour) -> [u8; 8] {
    let distance = near.distance_squared.sqrt() as f32;
    (u64::from(near.point) << 32 | u64::from(distance.to_bits())).to_le_bytes()
}

/// The k nearest points of each query.
pub(super) fn nearest(
    work: &Work<'_>,
    queries: &[[f32; 3]],
    k: usize,
    most: f32,
    path: &Path,
) -> Result<Nearest, Failure> {
    let count = queries.len().saturating_mul(k);
    let chunk = ((1 << 22) / (k * size_of::<Neighbour>())).clamp(1, 1 << 16);
    check(8 * count as u64, work.limit)?;
    let mut bytes = start(path, NEIGHBOUR, 8, count)?;
    let mut found = room(chunk.min(queries.len()) * k, Neighbour::NONE, work.limit)?;
    let options = NearestOptions {
        k,
        max_distance: most,
        max_memory: work.limit,
        watch: Some(&progress::Unseen),
        ..NearestOptions::default()
    };
    let bar = progress::bar(work.quiet, "nearest points", queries.len() as u64);
    let mut some = 0;
    for queries in queries.chunks(chunk) {
        let found = &mut found[..queries.len() * k];
        work.tree.nearest(queries, found, &options)?;
        some += found.iter().filter(|near| near.is_some()).count();
        bytes.extend(found.iter().flat_map(record));
        bar.inc(queries.len() as u64);
    }
    bar.finish_and_clear();
    files::write(path, &bytes)?;
    Ok(Nearest { queries: queries.len(), k, found: some })
}

fn check(needed: u64, limit: Option<u64>) -> Result<(), Failure> {
    match limit.filter(|&limit| needed > limit) {
        Some(limit) => Err(QueryError::OutOfMemory { needed, limit }.into()),
        None => Ok(()),
    }
}

/// All points within a radius of each query; gives the name of the second file too.
pub(super) fn within(
    work: &Work<'_>,
    queries: &[[f32; 3]],
    radius: f32,
    path: &Path,
) -> Result<(Found, PathBuf), Failure> {
    let beside = starts_beside(path);
    let mut starts = start(&beside, "'<u8'", 8, queries.len() + 1)?;
    starts.extend(0u64.to_le_bytes());
    let mut records: Vec<u8> = Vec::new();
    let bar = progress::bar(work.quiet, "points within", queries.len() as u64);
    let options = NearestOptions {
        max_distance: radius,
        max_memory: work.limit,
        watch: Some(&progress::Unseen),
        ..NearestOptions::default()
    };
    let kept = KeptBytes { list: 8, neighbour: 8 };
    work.tree.for_each_within(queries, &options, kept, |found| -> Result<(), Failure> {
        let needed = (records.len() + 8 * found.len()) as u64;
        let refused = |_| QueryError::OutOfMemory { needed, limit: needed };
        records.try_reserve(8 * found.len()).map_err(refused)?;
        records.extend(found.iter().flat_map(record));
        starts.extend((records.len() as u64 / 8).to_le_bytes());
        bar.inc(1);
        Ok(())
    })?;
    bar.finish_and_clear();
    let found = records.len() / 8;
    let mut bytes = start(path, NEIGHBOUR, 8, found)?;
    bytes.extend(records);
    files::write_together([
        (path.to_owned(), bytes.as_slice()),
        (beside.clone(), starts.as_slice()),
    ])?;
    Ok((Found { queries: queries.len(), radius, found }, beside))
}

/// The planes at all points; gives how many have none.
pub(super) fn normals(planes: &[Plane], path: &Path, limit: Option<u64>) -> Result<usize, Failure> {
    check(16 * planes.len() as u64, limit)?;
    let mut bytes = start(path, PLANE, 16, planes.len())?;
    for Plane { normal: [x, y, z], variation } in planes {
        bytes.extend([*x, *y, *z, *variation].into_iter().flat_map(f32::to_le_bytes));
    }
    files::write(path, &bytes)?;
    Ok(planes.iter().filter(|plane| **plane == Plane::NONE).count())
}

/// A byte for each point: statistical outliers (Rusu et al. 2008).
pub(super) fn outliers(
    work: &Work<'_>,
    k: usize,
    deviations: f32,
    path: &Path,
) -> Result<Outliers, Failure> {
    // The point itself is among its nearest, or points in the same place stand for it: one of them does not count.
    let means =
        work.map("distances", work.points, (k + 1, f32::INFINITY), f64::NAN, |_, found| {
            let others = found.get(1..).unwrap_or(&[]);
            let sum: f64 = others.iter().map(|near| near.distance_squared.sqrt()).sum();
            sum / others.len().max(1) as f64
        })?;
    // Points that were left out, and points alone, have no distance to others.
    let is_kept = |index: usize| work.points[index].iter().all(|x| x.is_finite());
    let kept = || (0..means.len()).filter(|&index| is_kept(index)).map(|index| means[index]);
    let count = kept().count().max(1) as f64;
    let mean = kept().sum::<f64>() / count;
    let variance = kept().map(|own| (own - mean) * (own - mean)).sum::<f64>() / count;
    let most = mean + f64::from(deviations) * variance.sqrt();
    let mut bytes = start(path, "'|u1'", 1, means.len())?;
    let mut found = 0;
    for (index, &own) in means.iter().enumerate() {
        let byte = match is_kept(index) {
            true => u8::from(own > most),
            false => 2,
        };
        found += usize::from(byte == 1);
        bytes.push(byte);
    }
    files::write(path, &bytes)?;
    Ok(Outliers { mean, beyond: most, found })
}

/// A cloud of which no two points are nearer than a spacing; each that is left out is nearer than it to one that stays.
pub(super) fn thin(work: &Work<'_>, spacing: f32, path: &Path) -> Result<Thinned, Failure> {
    let mut gone = room(work.points.len(), false, work.limit)?;
    let mut kept = room(0, [0.0f32; 3], work.limit)?;
    let bar = progress::bar(work.quiet, "thinning", work.points.len() as u64);
    let squared = f64::from(spacing) * f64::from(spacing);
    for (index, &point) in work.points.iter().enumerate() {
        if index % FEW == 0 {
            ending::check()?;
            bar.set_position(index as u64);
        }
        if gone[index] || !point.iter().all(|x| x.is_finite()) {
            continue;
        }
        check(12 * (kept.len() as u64 + 1), work.limit)?;
        let refused = |_| Failure::limit("there is not memory enough for the thinned cloud");
        kept.try_reserve(1).map_err(refused)?;
        kept.push(point);
        // No two points are nearer than 0; of a pile each would look at all others.
        if squared == 0.0 {
            continue;
        }
        let still = |other: u32| !gone[other as usize] && other as usize > index;
        let options = NearestOptions {
            max_distance: spacing,
            filter: Some(&still),
            max_memory: work.limit,
            ..NearestOptions::default()
        };
        let near = work.tree.within(point, &options)?;
        for other in near.iter().filter(|other| other.distance_squared < squared) {
            gone[other.point as usize] = true;
        }
    }
    bar.finish_and_clear();
    files::write(path, &cloud::to_bytes(path, &kept)?)?;
    Ok(Thinned { spacing, kept: kept.len() })
}
