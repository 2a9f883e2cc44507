//! Options by their names and numbers.

use splitplane::objects::{IgnoredTriangle, InstanceId, SceneOptions};
use splitplane::{Accuracy, BuildOptions, Culling, Preset, QueryLayout, QueryOptions};

use crate::failure::Failure;

fn unknown(what: &str, name: &str, known: &str) -> Failure {
    Failure::new("config", format!("there is no {what} `{name}`; there are {known}"))
}

/// The options of a build.
pub(crate) fn build_options(
    preset: &str,
    layout: &str,
    max_memory: Option<f64>,
) -> Result<BuildOptions<'static>, Failure> {
    let preset: Preset =
        preset.parse().map_err(|_| unknown("preset", preset, "fast, narrow, balanced and best"))?;
    let found = QueryLayout::ALL.into_iter().find(|known| known.name() == layout);
    let layout = found.ok_or_else(|| unknown("layout", layout, "fast and compact"))?;
    // A float becomes the nearest integer; NaN is 0.
    let max_memory = max_memory.map(|bytes| bytes as u64);
    Ok(BuildOptions { layout, max_memory, ..BuildOptions::from(preset) })
}

/// The number that stands for no triangle and no instance.
pub(crate) const NONE: u32 = u32::MAX;

/// An accuracy by its place in [`Accuracy::ALL`].
pub(crate) fn accuracy(number: u32) -> Result<Accuracy, Failure> {
    let found = Accuracy::ALL.get(number as usize).copied();
    found.ok_or_else(|| Failure::new("config", "there is no accuracy of this number"))
}

/// Which side is ignored: none, back, front.
pub(crate) fn culling(number: u32) -> Result<Culling, Failure> {
    match number {
        0 => Ok(Culling::None),
        1 => Ok(Culling::Back),
        2 => Ok(Culling::Front),
        _ => Err(Failure::new("config", "there is no culling of this number")),
    }
}

pub(crate) fn query_options(
    test: u32,
    side: u32,
    ignore: u32,
) -> Result<QueryOptions<'static>, Failure> {
    let ignore = (ignore != NONE).then_some(ignore);
    let (accuracy, culling) = (accuracy(test)?, culling(side)?);
    Ok(QueryOptions { accuracy, culling, ignore, ..QueryOptions::default() })
}

/// Three rows of four numbers, from an object to the world.
pub(crate) fn transform(numbers: &[f32]) -> Result<[[f32; 4]; 3], Failure> {
    match numbers.as_chunks::<4>() {
        ([one, two, three], []) => Ok([*one, *two, *three]),
        _ => Err(Failure::new(
            "shape",
            format!("a transform has {} numbers, but must have 12", numbers.len()),
        )),
    }
}

/// Numbers of accuracy, culling, mask, and the ignored instance and triangle.
pub(crate) fn scene_options(numbers: &[u32]) -> Result<SceneOptions<'static>, Failure> {
    let &[test, side, mask, instance, triangle] = numbers else {
        return Err(Failure::new("config", "the options of a scene's query are five numbers"));
    };
    let (accuracy, culling) = (accuracy(test)?, culling(side)?);
    let ignore =
        (instance != NONE).then_some(IgnoredTriangle { instance: InstanceId(instance), triangle });
    Ok(SceneOptions { accuracy, culling, mask, ignore, ..SceneOptions::default() })
}
