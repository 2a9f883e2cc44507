//! The instances of a scene file, and where they are in its frames.

use super::format::{self, File, Rotation, Scale};
use super::geometries::Geometries;
use super::locate::Step;
use super::{At, MAX_INSTANCES, SceneFileProblem, material};
use crate::budget::Budget;
use crate::from_file::quoted;
use crate::instanced::{InstancedScene, Key, Placed, Pose, pose};
use splitplane_core::ray::Culling;
use splitplane_core::scene::{ObjectSpace, Transform};
use std::collections::HashMap;

pub(super) fn read(
    file: &File<'_>,
    scene: &mut InstancedScene,
    materials: &HashMap<&str, u32>,
    geometries: &Geometries<'_>,
    budget: &Budget,
) -> Result<(), At> {
    if file.instances.len() > MAX_INSTANCES {
        let problem = SceneFileProblem::TooMany { what: "instances", most: MAX_INSTANCES };
        return Err((vec![Step::Field("instances")], problem));
    }
    budget
        .grow_exact(&mut scene.instances, file.instances.len())
        .map_err(|full| (vec![Step::Field("instances")], full.into()))?;
    for (index, own) in file.instances.iter().enumerate() {
        let whole = || vec![Step::Field("instances"), Step::Element(index)];
        let at = |name| [whole(), vec![Step::Field(name)]].concat();
        let geometry = geometries.get(&own.geometry).ok_or_else(|| {
            let name = quoted(&own.geometry);
            (at("geometry"), SceneFileProblem::Unknown { what: "geometry", name })
        })?;
        let material = material(materials, own.material.as_deref(), || at("material"))?;
        let mut keys = Vec::new();
        budget.grow_exact(&mut keys, own.keys.len()).map_err(|full| (at("keys"), full.into()))?;
        read_keys(own, file.frames, &mut keys)
            .map_err(|(key, problem)| ([at("keys"), vec![Step::Element(key)]].concat(), problem))?;
        let transform = if keys.is_empty() {
            placed(own).map_err(|(name, problem)| (at(name), problem))?
        } else {
            pose::at(&keys, 0)
        };
        if ObjectSpace::new(&transform).is_none() {
            return Err((whole(), SceneFileProblem::Singular));
        }
        let culling = match own.culling {
            format::Culling::None => Culling::None,
            format::Culling::Back => Culling::Back,
            format::Culling::Front => Culling::Front,
        };
        scene.instances.push(Placed {
            mask: own.mask.unwrap_or(u32::MAX),
            id: own.id.unwrap_or(0),
            culling,
            material,
            keys,
            ..Placed::new(geometry, transform)
        });
    }
    Ok(())
}

/// Where an instance without keys stands.
fn placed(own: &format::Instance<'_>) -> Result<Transform, (&'static str, SceneFileProblem)> {
    let apart = own.translate.is_some() || own.rotate.is_some() || own.scale.is_some();
    match own.transform.as_deref() {
        Some(_) if apart => Err((
            "transform",
            SceneFileProblem::Wrong("give `transform`, or `translate`, `rotate` and `scale`"),
        )),
        Some([a, b, c, d, e, f, g, h, i, j, k, l]) => {
            Ok([[*a, *b, *c, *d], [*e, *f, *g, *h], [*i, *j, *k, *l]])
        }
        None => pose_of(own.translate, own.rotate.as_deref(), own.scale.as_ref())
            .map(|pose| pose.transform())
            .map_err(|problem| ("rotate", problem)),
    }
}

/// Its keys, each of which has an inverse, as have the frames between two.
fn read_keys(
    own: &format::Instance<'_>,
    frames: u32,
    keys: &mut Vec<Key>,
) -> Result<(), (usize, SceneFileProblem)> {
    let apart = own.translate.is_some() || own.rotate.is_some() || own.scale.is_some();
    for (index, key) in own.keys.iter().enumerate() {
        let wrong = |what| (index, SceneFileProblem::Wrong(what));
        if apart || own.transform.is_some() {
            return Err(wrong("an instance with keys has no other place"));
        }
        if key.frame >= frames {
            return Err(wrong("the frame is not one of the scene's; they are counted from 0"));
        }
        if keys.last().is_some_and(|last| last.frame >= key.frame) {
            return Err(wrong("keys are in ascending order of their frames"));
        }
        let pose = pose_of(key.translate, key.rotate.as_deref(), key.scale.as_ref())
            .map_err(|problem| (index, problem))?;
        if let Some(last) = keys.last()
            && (0..3).any(|k| (last.pose.scale[k] < 0.0) != (pose.scale[k] < 0.0))
        {
            return Err(wrong("between a key and its reflection a scale would be 0"));
        }
        if ObjectSpace::new(&pose.transform()).is_none() {
            return Err((index, SceneFileProblem::Singular));
        }
        keys.push(Key { frame: key.frame, pose });
    }
    Ok(())
}

fn pose_of(
    translate: Option<[f64; 3]>,
    rotate: Option<&Rotation>,
    scale: Option<&Scale>,
) -> Result<Pose, SceneFileProblem> {
    let rotate = match rotate {
        None => Pose::IDENTITY.rotate,
        Some(Rotation { axis, degrees }) => Pose::rotation(*axis, *degrees)
            .ok_or(SceneFileProblem::Wrong("the axis of a rotation is zero"))?,
    };
    let scale = match scale {
        None => [1.0; 3],
        Some(Scale::Even(factor)) => [*factor; 3],
        Some(Scale::ByAxis(factors)) => **factors,
    };
    Ok(Pose { translate: translate.unwrap_or_default(), rotate, scale })
}
