//! Geometries that are not meshes, and parts of meshes that rays pass.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use splitplane::core::scene::shape::{Capsule, Shapes, Sphere};
use splitplane::objects::{GeometryId, OpacityMask};

use crate::arrays::{flat, rows};
use crate::failure::Failure;
use crate::scene::Scene;

fn copied<T: Copy>(slice: &[T]) -> Result<Vec<T>, Failure> {
    let mut own = Vec::new();
    own.try_reserve_exact(slice.len()).map_err(|_| Failure::memory(size_of_val(slice)))?;
    own.extend_from_slice(slice);
    Ok(own)
}

fn shapes(kind: &str, numbers: &PyReadonlyArray2<'_, f32>) -> Result<Shapes, Failure> {
    match kind {
        "spheres" => {
            let spheres: &[Sphere] = bytemuck::cast_slice(rows::<f32, 4>(numbers, "spheres")?);
            Ok(Shapes::Spheres(copied(spheres)?))
        }
        "capsules" => {
            let capsules: &[Capsule] = bytemuck::cast_slice(rows::<f32, 7>(numbers, "capsules")?);
            Ok(Shapes::Capsules(copied(capsules)?))
        }
        _ => {
            let text = format!("there are no shapes `{kind}`; there are spheres and capsules");
            Err(Failure::new("ConfigError", text))
        }
    }
}

/// Adds spheres or capsules; the geometry's name.
#[pyfunction]
pub(crate) fn add_shapes(
    scene: &Scene,
    kind: &str,
    numbers: PyReadonlyArray2<'_, f32>,
) -> PyResult<u32> {
    let shapes = shapes(kind, &numbers)?;
    let added = scene.edit(|description| Ok(description.add_shapes(shapes)?))?;
    Ok(added.0)
}

/// Gives a geometry of shapes others.
#[pyfunction]
pub(crate) fn replace_shapes(
    scene: &Scene,
    geometry: u32,
    kind: &str,
    numbers: PyReadonlyArray2<'_, f32>,
) -> PyResult<()> {
    let shapes = shapes(kind, &numbers)?;
    let name = GeometryId(geometry);
    Ok(scene.edit(|description| Ok(description.replace_shapes(name, shapes)?))?)
}

/// What a geometry consists of: `triangles`, `spheres` or `capsules`.
#[pyfunction]
pub(crate) fn kind_of(scene: &Scene, geometry: u32) -> PyResult<&'static str> {
    let kind =
        scene.look(|description| Ok(description.geometry(GeometryId(geometry))?.kind_name()))?;
    Ok(kind)
}

/// Says by words of 32 cells which parts of a geometry's triangles count; without words all do.
#[pyfunction]
pub(crate) fn set_opacity(
    scene: &Scene,
    geometry: u32,
    mask: Option<(u32, PyReadonlyArray1<'_, u32>)>,
) -> PyResult<()> {
    let words = match &mask {
        Some((level, words)) => Some((*level, flat(words, "the opacity mask")?)),
        None => None,
    };
    let name = GeometryId(geometry);
    Ok(scene.edit(|description| {
        let triangles = description.geometry(name)?.mesh().len();
        let mask = match words {
            Some((level, words)) => Some(OpacityMask::of_words(triangles, level, words)?),
            None => None,
        };
        Ok(description.set_opacity(name, mask)?)
    })?)
}

/// Level, triangles and words of a geometry's opacity mask.
type Opacity<'py> = Option<(u32, u32, Bound<'py, PyArray1<u32>>)>;

/// The opacity mask of a geometry; none where all of it counts.
#[pyfunction]
pub(crate) fn opacity<'py>(
    py: Python<'py>,
    scene: &Scene,
    geometry: u32,
) -> PyResult<Opacity<'py>> {
    let found = scene.look(|description| {
        let mask = description.opacity(GeometryId(geometry))?;
        mask.map(|own| Ok((own.level(), own.triangles(), copied(own.words())?))).transpose()
    })?;
    Ok(found.map(|(level, triangles, words)| (level, triangles, words.into_pyarray(py))))
}

/// The middles of the cells of a triangle, in order: u and v of each.
#[pyfunction]
pub(crate) fn opacity_cells(py: Python<'_>, level: u32) -> PyResult<Bound<'_, PyArray1<f32>>> {
    let mut middles = Vec::new();
    let cells = 1usize.checked_shl(2 * level).unwrap_or(usize::MAX);
    middles
        .try_reserve_exact(2 * cells.min(1 << 24))
        .map_err(|_| Failure::memory(8 * cells.min(1 << 24)))?;
    // The level is checked before the first cell is shown.
    OpacityMask::new(1, level, |_, middle| {
        middles.extend(middle);
        false
    })
    .map_err(Failure::from)?;
    Ok(middles.into_pyarray(py))
}
