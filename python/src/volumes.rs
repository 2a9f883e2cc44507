//! Volumes that triangles may meet, and bodies that move until they touch one.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1};
use pyo3::prelude::*;
use splitplane::objects::SceneOverlapOptions;
use splitplane::{Aabb, Cast, CastOptions, Impact, OverlapOptions, Plane, Ray, Volume, Watch};

use crate::arrays::{flat, reserved, room, rows};
use crate::call::{Call, Part};
use crate::failure::Failure;
use crate::options::{Counts, add, counts};
use crate::rays::{CHUNK, LimitArgument, Rays};
use crate::scene::{Scene, ignored};
use crate::tree::Tree;

/// Starts, triangles, and the counts of the report.
type Met<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<u32>>, Counts);

/// Starts, triangles, instances.
type MetInScene<'py> =
    (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>);

/// Mask, and an (instance, triangle) to ignore.
type SceneArguments = (u32, Option<(u32, u32)>);

fn point(numbers: &[f32]) -> [f32; 3] {
    [numbers[0], numbers[1], numbers[2]]
}

/// Rows of numbers as volumes. `planes` is where those of each set begin, among the rows, and how many there are.
struct Volumes<'a> {
    kind: &'a str,
    numbers: &'a [f32],
    columns: usize,
    planes: Vec<Plane>,
    starts: &'a [i64],
}

impl<'a> Volumes<'a> {
    fn new(
        kind: &'a str,
        array: &'a PyReadonlyArray2<'_, f32>,
        starts: &'a PyReadonlyArray1<'_, i64>,
    ) -> Result<Volumes<'a>, Failure> {
        let columns = match kind {
            "box" => 6,
            "ball" | "planes" => 4,
            "capsule" => 7,
            "triangle" => 9,
            _ => {
                let text = format!(
                    "there is no volume `{kind}`; there are box, ball, capsule, triangle and planes"
                );
                return Err(Failure::new("ConfigError", text));
            }
        };
        let (found, starts) = (array.as_array().ncols(), flat(starts, "starts")?);
        if found != columns {
            let text = format!("a {kind} has {columns} numbers, not {found}");
            return Err(Failure::new("ShapeError", text));
        }
        let numbers = array
            .as_slice()
            .map_err(|_| Failure::new("ShapeError", "volumes must be contiguous and aligned"))?;
        let mut planes = Vec::new();
        if kind == "planes" {
            let count = numbers.len() / columns;
            let in_order = starts.windows(2).all(|ends| ends[0] <= ends[1]);
            if starts.first() != Some(&0) || starts.last() != Some(&(count as i64)) || !in_order {
                return Err(Failure::new("ShapeError", "starts of planes are not in order"));
            }
            planes
                .try_reserve_exact(count)
                .map_err(|_| Failure::memory(count * size_of::<Plane>()))?;
            planes.extend(
                numbers
                    .as_chunks::<4>()
                    .0
                    .iter()
                    .map(|&[a, b, c, offset]| Plane { normal: [a, b, c], offset }),
            );
        }
        Ok(Volumes { kind, numbers, columns, planes, starts })
    }

    fn len(&self) -> usize {
        match self.kind {
            "planes" => self.starts.len() - 1,
            _ => self.numbers.len() / self.columns,
        }
    }

    fn at(&self, place: usize) -> Volume<'_> {
        if self.kind == "planes" {
            let here = self.starts[place] as usize..self.starts[place + 1] as usize;
            return Volume::Planes(&self.planes[here]);
        }
        let own = &self.numbers[place * self.columns..][..self.columns];
        match self.kind {
            "box" => Volume::Box(Aabb { lo: point(own), hi: point(&own[3..]) }),
            "ball" => Volume::Ball { centre: point(own), radius: own[3] },
            "capsule" => Volume::Capsule { from: point(own), to: point(&own[3..]), radius: own[6] },
            _ => Volume::Triangle([point(own), point(&own[3..]), point(&own[6..])]),
        }
    }

    /// All volumes, as the library takes them.
    fn all(&self) -> Result<Vec<Volume<'_>>, Failure> {
        let mut all = Vec::new();
        let count = self.len();
        all.try_reserve_exact(count)
            .map_err(|_| Failure::memory(count * size_of::<Volume<'_>>()))?;
        all.extend((0..count).map(|place| self.at(place)));
        Ok(all)
    }
}

/// A list of what `of` gives of each.
fn column<S, T>(from: &[S], of: impl FnMut(&S) -> T) -> Result<Vec<T>, Failure> {
    let mut own = Vec::new();
    own.try_reserve_exact(from.len()).map_err(|_| Failure::memory(from.len() * size_of::<T>()))?;
    own.extend(from.iter().map(of));
    Ok(own)
}

/// Where lists begin, as Python has it.
fn places(starts: &[usize]) -> Result<Vec<i64>, Failure> {
    column(starts, |&start| start as i64)
}

/// See `splitplane.Tree.overlaps`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "what Python hands over, argument by argument")]
pub(crate) fn overlaps<'py>(
    py: Python<'py>,
    tree: &Tree,
    kind: &str,
    volumes: PyReadonlyArray2<'py, f32>,
    starts: PyReadonlyArray1<'py, i64>,
    ignore: Option<u32>,
    max_memory: Option<u64>,
    call: Call,
) -> PyResult<Met<'py>> {
    let volumes = Volumes::new(kind, &volumes, &starts)?;
    let state = tree.read()?;
    state.opened.check_process()?;
    let accelerator = &state.accelerator;
    let (starts, met, counts) = call.run(py, |watcher| {
        let all = volumes.all()?;
        let options = OverlapOptions { ignore, max_memory, watch: Some(watcher) };
        let found = accelerator.overlaps(&all, &options)?;
        Ok((places(&found.starts)?, found.triangles, counts(&found.report)))
    })?;
    Ok((starts.into_pyarray(py), met.into_pyarray(py), counts))
}

/// See `splitplane.Tree.overlaps_any`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "what Python hands over, argument by argument")]
pub(crate) fn overlaps_any(
    py: Python<'_>,
    tree: &Tree,
    kind: &str,
    volumes: PyReadonlyArray2<'_, f32>,
    starts: PyReadonlyArray1<'_, i64>,
    ignore: Option<u32>,
    mut found: PyReadwriteArray1<'_, bool>,
    call: Call,
) -> PyResult<Counts> {
    let volumes = Volumes::new(kind, &volumes, &starts)?;
    let found = room(&mut found, volumes.len())?;
    let state = tree.read()?;
    state.opened.check_process()?;
    let accelerator = &state.accelerator;
    call.run(py, |watcher| {
        let all = volumes.all()?;
        let options = OverlapOptions { ignore, max_memory: None, watch: Some(watcher) };
        Ok(counts(&accelerator.overlaps_any(&all, found, &options)?))
    })
}

/// See `splitplane.Scene.overlaps`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "what Python hands over, argument by argument")]
pub(crate) fn scene_overlaps<'py>(
    py: Python<'py>,
    scene: &Scene,
    kind: &str,
    volumes: PyReadonlyArray2<'py, f32>,
    starts: PyReadonlyArray1<'py, i64>,
    own: SceneArguments,
    max_memory: Option<u64>,
    call: Call,
) -> PyResult<MetInScene<'py>> {
    let volumes = Volumes::new(kind, &volumes, &starts)?;
    let (state, (mask, ignore)) = (scene.current()?, (own.0, ignored(own.1)));
    let built = &state.built;
    let (starts, triangles, instances) = call.run(py, |watcher| {
        let options = SceneOverlapOptions { mask, ignore, max_memory, watch: Some(watcher) };
        let found = built.overlaps(&volumes.all()?, &options)?;
        let triangles = column(&found.triangles, |own| own.triangle)?;
        let instances = column(&found.triangles, |own| own.instance)?;
        Ok((places(&found.starts)?, triangles, instances))
    })?;
    Ok((starts.into_pyarray(py), triangles.into_pyarray(py), instances.into_pyarray(py)))
}

/// See `splitplane.Scene.overlaps_any`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "what Python hands over, argument by argument")]
pub(crate) fn scene_overlaps_any(
    py: Python<'_>,
    scene: &Scene,
    kind: &str,
    volumes: PyReadonlyArray2<'_, f32>,
    starts: PyReadonlyArray1<'_, i64>,
    own: SceneArguments,
    mut found: PyReadwriteArray1<'_, bool>,
    call: Call,
) -> PyResult<()> {
    let volumes = Volumes::new(kind, &volumes, &starts)?;
    let found = room(&mut found, volumes.len())?;
    let (state, (mask, ignore)) = (scene.current()?, (own.0, ignored(own.1)));
    let built = &state.built;
    call.run(py, |watcher| {
        let options = SceneOverlapOptions { mask, ignore, max_memory: None, watch: Some(watcher) };
        built.overlaps_any(&volumes.all()?, found, &options)
    })
}

/// See `splitplane.Tree.impacts`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "what Python hands over, argument by argument")]
pub(crate) fn impacts(
    py: Python<'_>,
    tree: &Tree,
    rays: PyReadonlyArray2<'_, f32>,
    limits: (LimitArgument<'_>, LimitArgument<'_>),
    radii: PyReadonlyArray1<'_, f32>,
    axes: PyReadonlyArray2<'_, f32>,
    ignore: Option<u32>,
    mut t: PyReadwriteArray1<'_, f32>,
    mut triangle: PyReadwriteArray1<'_, u32>,
    call: Call,
) -> PyResult<Counts> {
    let rays = Rays::new(&rays, &limits.0, &limits.1)?;
    let (radii, axes) = (flat(&radii, "radius")?, rows::<f32, 3>(&axes, "axis")?);
    let total = rays.len();
    if radii.len() != total || axes.len() != total {
        return Err(Failure::new("ShapeError", "rays, radii and axes differ in number").into());
    }
    let (t, triangle) = (room(&mut t, total)?, room(&mut triangle, total)?);
    let state = tree.read()?;
    state.opened.check_process()?;
    let accelerator = &state.accelerator;
    call.run(py, |watcher| {
        let mut sum = Counts::default();
        let blank = Cast::ball(Ray::new([0.0; 3], [0.0; 3]), 0.0);
        let mut casts = reserved(total.min(CHUNK), blank)?;
        let mut found = reserved(total.min(CHUNK), Impact::NONE)?;
        rays.in_chunks(CHUNK, |rays, first| {
            let (casts, found) = (&mut casts[..rays.len()], &mut found[..rays.len()]);
            for (place, (cast, ray)) in (first..).zip(casts.iter_mut().zip(rays)) {
                *cast = Cast { ray: *ray, axis: axes[place], radius: radii[place] };
            }
            let part = Part { watcher, first, total };
            let watch: Option<&dyn Watch> = Some(&part);
            add(&mut sum, &accelerator.impacts(casts, found, &CastOptions { ignore, watch })?);
            for (place, impact) in (first..).zip(found) {
                (t[place], triangle[place]) = (impact.t, impact.triangle);
            }
            Ok(())
        })?;
        Ok(sum)
    })
}
