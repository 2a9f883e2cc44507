//! A tree of points.

use std::collections::BTreeMap;
use std::sync::Arc;

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1};
use pyo3::prelude::*;
use rayon::prelude::*;
use splitplane::Preset;
use splitplane::core::error::QueryError;
use splitplane::points::{AnyPointTree, Axes, KeptBytes, NearestOptions, Neighbour, PointOptions};

use crate::arrays::{flat, reserved, room, rows};
use crate::call::{Call, Part};
use crate::failure::Failure;
use crate::open::{Opened, open};

/// Neighbours that are found at once.
const CHUNK: usize = 1 << 20;
/// What is kept of all within a radius: where a list ends; an index and a distance.
const KEPT: KeptBytes = KeptBytes { list: 8, neighbour: 12 };

enum OfDimensions {
    One(AnyPointTree<1>),
    Two(AnyPointTree<2>),
    Three(AnyPointTree<3>),
    Four(AnyPointTree<4>),
}

/// Does the same for the tree of any number of dimensions.
macro_rules! with_tree {
    ($tree:expr, $name:ident => $do:expr) => {
        match &$tree.own {
            OfDimensions::One($name) => $do,
            OfDimensions::Two($name) => $do,
            OfDimensions::Three($name) => $do,
            OfDimensions::Four($name) => $do,
        }
    };
}

/// See `splitplane.PointTree`.
#[pyclass(frozen, module = "splitplane._native")]
pub(crate) struct PointTree {
    own: OfDimensions,
    opened: Arc<Opened>,
}

fn build<const N: usize>(
    py: Python<'_>,
    opened: &Opened,
    points: &PyReadonlyArray2<'_, f32>,
    options: &PointOptions<'_>,
    call: &Call,
) -> PyResult<AnyPointTree<N>> {
    let points = rows::<f32, N>(points, "points")?;
    call.run(py, |watcher| {
        Ok(opened.engine.points(points, &PointOptions { watch: Some(watcher), ..*options })?)
    })
}

/// Greatest distance, most bytes.
type Limits = (f32, Option<u64>);
/// Starts, indices, squared distances.
type Within<'py> =
    (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl PointTree {
    /// Builds a tree.
    #[staticmethod]
    fn build(
        py: Python<'_>,
        points: PyReadonlyArray2<'_, f32>,
        axes: &str,
        max_memory: Option<u64>,
        backend: (String, Option<String>),
        call: Call,
    ) -> PyResult<PointTree> {
        let axes = match axes {
            "widest" => Axes::Widest,
            "cycle" => Axes::Cycle,
            _ => {
                let text = format!("there are no axes `{axes}`; there are widest and cycle");
                return Err(Failure::new("ConfigError", text).into());
            }
        };
        let options = PointOptions { axes, max_memory, watch: None };
        let opened = open(py, &backend.0, backend.1.as_deref(), Preset::Fast)?;
        let own = match points.as_array().ncols() {
            1 => OfDimensions::One(build(py, &opened, &points, &options, &call)?),
            2 => OfDimensions::Two(build(py, &opened, &points, &options, &call)?),
            3 => OfDimensions::Three(build(py, &opened, &points, &options, &call)?),
            4 => OfDimensions::Four(build(py, &opened, &points, &options, &call)?),
            dimensions => {
                let text = format!("a point tree has 1 to 4 dimensions, not {dimensions}");
                return Err(Failure::new("ShapeError", text).into());
            }
        };
        Ok(PointTree { own, opened })
    }

    /// The backend, and why it is this one.
    fn backend(&self) -> (String, String) {
        (self.opened.name.clone(), self.opened.reason.clone())
    }

    /// 16 hexadecimal digits.
    fn digest(&self, py: Python<'_>) -> String {
        py.detach(|| with_tree!(self, tree => tree.tree().digest())).to_string()
    }

    /// Numbers about the tree, by name.
    fn summary(&self) -> BTreeMap<&'static str, u64> {
        let (report, bytes) = with_tree!(self, tree => (tree.tree().report(), tree.bytes()));
        BTreeMap::from([
            ("points", u64::from(report.points)),
            ("dropped", u64::from(report.dropped)),
            ("bytes", bytes),
        ])
    }

    /// See `splitplane.PointTree.nearest`.
    #[expect(clippy::too_many_arguments, reason = "what Python hands over, argument by argument")]
    fn nearest(
        &self,
        py: Python<'_>,
        queries: PyReadonlyArray2<'_, f32>,
        k: usize,
        limits: Limits,
        keep: Option<PyReadonlyArray1<'_, bool>>,
        mut squared: PyReadwriteArray1<'_, f64>,
        mut index: PyReadwriteArray1<'_, u32>,
        call: Call,
    ) -> PyResult<()> {
        self.opened.check_process()?;
        let keep = keep.as_ref().map(|keep| flat(keep, "keep")).transpose()?;
        with_tree!(self, tree => {
            let queries = rows(&queries, "queries")?;
            let places = queries.len().saturating_mul(k);
            let (squared, index) = (room(&mut squared, places)?, room(&mut index, places)?);
            nearest(py, tree, queries, (k, limits, keep), squared, index, &call)
        })
    }

    /// See `splitplane.PointTree.within`.
    fn within<'py>(
        &self,
        py: Python<'py>,
        queries: PyReadonlyArray2<'py, f32>,
        limits: Limits,
        keep: Option<PyReadonlyArray1<'py, bool>>,
        call: Call,
    ) -> PyResult<Within<'py>> {
        self.opened.check_process()?;
        let keep = keep.as_ref().map(|keep| flat(keep, "keep")).transpose()?;
        with_tree!(self, tree => within(py, tree, rows(&queries, "queries")?, limits, keep, &call))
    }
}

/// Whether a point counts, by an array with an entry for each.
fn keeps(keep: Option<&[bool]>, point: u32) -> bool {
    keep.is_none_or(|keep| keep.get(point as usize).copied().unwrap_or(false))
}

fn check_keep<const N: usize>(
    tree: &AnyPointTree<N>,
    keep: Option<&[bool]>,
) -> Result<(), Failure> {
    let points = tree.tree().report().points as usize;
    match keep {
        Some(keep) if keep.len() != points => {
            let text = format!("keep has {} entries for {points} points", keep.len());
            Err(Failure::new("ShapeError", text))
        }
        _ => Ok(()),
    }
}

fn nearest<const N: usize>(
    py: Python<'_>,
    tree: &AnyPointTree<N>,
    queries: &[[f32; N]],
    (k, (max_distance, max_memory), keep): (usize, Limits, Option<&[bool]>),
    squared: &mut [f64],
    index: &mut [u32],
    call: &Call,
) -> PyResult<()> {
    check_keep(tree, keep)?;
    if k == 0 || queries.is_empty() {
        return Ok(());
    }
    call.run(py, |watcher| {
        let chunk = (CHUNK / k).max(1);
        let held = (chunk.min(queries.len()) * k * size_of::<Neighbour>()) as u64;
        if let Some(limit) = max_memory.filter(|&limit| held > limit) {
            return Err(QueryError::OutOfMemory { needed: held, limit }.into());
        }
        let max_memory = max_memory.map(|limit| limit - held);
        let mut found = reserved(chunk.min(queries.len()) * k, Neighbour::NONE)?;
        let filter = |point| keeps(keep, point);
        let filter: Option<&(dyn Fn(u32) -> bool + Sync)> = keep.is_some().then_some(&filter);
        for (number, few) in queries.chunks(chunk).enumerate() {
            let first = number * chunk;
            let watch = Part { watcher, first, total: queries.len() };
            let options =
                NearestOptions { k, max_distance, filter, max_memory, watch: Some(&watch) };
            let found = &mut found[..few.len() * k];
            tree.nearest(few, found, &options)?;
            let here = first * k..(first + few.len()) * k;
            let outs = squared[here.clone()].par_iter_mut().zip(&mut index[here]);
            outs.zip(found).with_min_len(1 << 13).for_each(|((squared, index), found)| {
                (*squared, *index) = (found.distance_squared, found.point);
            });
        }
        Ok(())
    })
}

fn within<'py, const N: usize>(
    py: Python<'py>,
    tree: &AnyPointTree<N>,
    queries: &[[f32; N]],
    (max_distance, max_memory): Limits,
    keep: Option<&[bool]>,
    call: &Call,
) -> PyResult<Within<'py>> {
    check_keep(tree, keep)?;
    let (starts, index, squared) = call.run(py, |watcher| {
        let mut starts = Vec::new();
        starts
            .try_reserve_exact(queries.len() + 1)
            .map_err(|_| Failure::memory(8 * queries.len()))?;
        starts.push(0);
        let (mut index, mut squared) = (Vec::new(), Vec::new());
        let filter = |point| keeps(keep, point);
        let filter: Option<&(dyn Fn(u32) -> bool + Sync)> = keep.is_some().then_some(&filter);
        let options =
            NearestOptions { k: 0, max_distance, filter, max_memory, watch: Some(watcher) };
        tree.for_each_within(queries, &options, KEPT, |found| -> Result<(), Failure> {
            let held = 12 * (index.len() + found.len());
            index.try_reserve(found.len()).map_err(|_| Failure::memory(held))?;
            squared.try_reserve(found.len()).map_err(|_| Failure::memory(held))?;
            index.extend(found.iter().map(|found| found.point));
            squared.extend(found.iter().map(|found| found.distance_squared));
            starts.push(index.len() as i64);
            Ok(())
        })?;
        Ok((starts, index, squared))
    })?;
    Ok((starts.into_pyarray(py), index.into_pyarray(py), squared.into_pyarray(py)))
}
