//! Instances baked into meshes, against corners that are computed here.

use std::collections::BTreeSet;

use super::Run;
use super::model::{Corners, Model};
use crate::source::Source;
use splitplane_core::scene::{BakeError, IDENTITY, Instance, InstanceId, SceneError};

/// Most triangles of a baked mesh: baking what is baked multiplies them.
const MOST: usize = 1500;

/// Groups of names: most of them instances that agree in all that they must, some of anything.
fn groups(source: &mut Source<'_>, model: &Model) -> Vec<Vec<InstanceId>> {
    let names: Vec<u32> = model.instances.keys().copied().collect();
    let mut free = names.clone();
    let mut groups = Vec::new();
    for _ in 0..source.pick(&[1, 1, 2, 3]) {
        if source.once_in(8) || names.is_empty() {
            let any = (0..source.below(4)).map(|_| InstanceId(source.below(30) as u32));
            groups.push(any.collect());
            continue;
        }
        let like = model.instances[&names[source.below(names.len())]];
        let bits = source.bits() | source.bits();
        let (taken, left): (Vec<u32>, Vec<u32>) = free.iter().partition(|&name| {
            let own = model.instances[name];
            let plain = model.is_mesh(own.geometry.0) && !model.masked.contains(&own.geometry.0);
            let same = (own.mask, own.id, own.culling) == (like.mask, like.id, like.culling);
            same && plain && bits >> (name % 32) & 1 != 0
        });
        free = left;
        groups.push(taken.into_iter().map(InstanceId).collect());
    }
    groups
}

/// A corner in the world, by the operations that are promised.
fn moved(own: &Instance, corner: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = corner.map(f64::from);
    own.transform.map(|row| {
        let [a, b, c, d] = row.map(f64::from);
        (((a * x + b * y) + c * z) + d) as f32
    })
}

/// All that is wrong with some groups.
fn flaws(model: &Model, groups: &[Vec<InstanceId>]) -> Vec<BakeError> {
    let mut flaws = Vec::new();
    let mut seen = BTreeSet::new();
    for group in groups {
        let Some(first) = group.iter().min().map(|name| name.0) else { continue };
        for &InstanceId(instance) in group {
            if !seen.insert(instance) {
                flaws.push(BakeError::Twice { instance });
            }
            let Some(own) = model.instances.get(&instance) else {
                flaws.push(BakeError::Scene(SceneError::UnknownInstance { instance }));
                continue;
            };
            if model.shapes.contains(&own.geometry.0) {
                flaws.push(BakeError::Shapes { instance });
            }
            if model.masked.contains(&own.geometry.0) {
                flaws.push(BakeError::Opacity { instance });
            }
            if let Some(least) = model.instances.get(&first) {
                for (what, same) in [
                    ("mask", least.mask == own.mask),
                    ("number", least.id == own.id),
                    ("culling", least.culling == own.culling),
                ] {
                    if !same {
                        flaws.push(BakeError::Differs { instance, first, what });
                    }
                }
            }
            for (triangle, corners) in model.geometries[&own.geometry.0].iter().enumerate() {
                let beyond = |corner: &[f32; 3]| {
                    let is_finite = |p: &[f32; 3]| p.iter().all(|x| x.is_finite());
                    is_finite(corner) && !is_finite(&moved(own, *corner))
                };
                if corners.iter().any(beyond) {
                    flaws.push(BakeError::TooFar { instance, triangle: triangle as u32 });
                }
            }
        }
    }
    flaws
}

/// Bakes some instances, and most often goes on with what comes of it.
pub(super) fn bake(source: &mut Source<'_>, run: &mut Run<'_>) {
    let groups = groups(source, &run.model);
    let slices: Vec<&[InstanceId]> = groups.iter().map(Vec::as_slice).collect();
    let triangles_of = |name: &InstanceId| {
        let own = run.model.instances.get(&name.0)?;
        Some(run.model.geometries[&own.geometry.0].len())
    };
    let triangles: usize = groups.iter().flatten().filter_map(triangles_of).sum();
    if triangles > MOST {
        return;
    }
    let flaws = flaws(&run.model, &groups);
    let instances: usize = groups.iter().map(Vec::len).sum();
    let full = groups.iter().filter(|group| !group.is_empty()).count();
    // Three corners and three indices a triangle, and what the table says that it takes.
    let needed = (triangles * 48 + full * 40 + instances * 12) as u64;
    let is_known =
        |flaw: &BakeError| !matches!(flaw, BakeError::Scene(_) | BakeError::Twice { .. });
    if needed > 0 && flaws.iter().all(is_known) {
        assert_eq!(run.scene.baked_bytes(&slices), Ok(needed));
        let limit = source.pick(&[needed - 1, needed / 2, 0]);
        let refused = run.library.bake(&run.scene, &slices, limit).err();
        assert_eq!(refused, Some(BakeError::OutOfMemory { needed, limit }));
    }
    let limit = source.pick(&[needed, u64::MAX]);
    let (baked, table) = match run.library.bake(&run.scene, &slices, limit) {
        Ok(baked) => baked,
        Err(error) => {
            assert!(flaws.contains(&error), "{error:?} {flaws:?}");
            run.model.check(&run.scene);
            run.reached.unbaked += 1;
            return run.is_as_before();
        }
    };
    assert!(flaws.is_empty(), "{flaws:?}");
    let mut model = run.model.clone();
    let mut made = table.groups();
    let mut ordered: Vec<Vec<InstanceId>> = groups;
    ordered.retain(|group| !group.is_empty());
    ordered.iter_mut().for_each(|group| group.sort_unstable());
    ordered.sort_unstable();
    for group in &ordered {
        let (first, geometry) = made.next().expect("a group");
        assert_eq!(first, group[0]);
        let mut all: Vec<Corners> = Vec::new();
        for &name in group {
            let own = run.model.instances[&name.0];
            for (triangle, corners) in run.model.geometries[&own.geometry.0].iter().enumerate() {
                let place = all.len() as u32;
                let original = Some((name, own.geometry, triangle as u32));
                assert_eq!(table.original(first, place), original);
                all.push(corners.map(|corner| moved(&own, corner)));
            }
            model.instances.remove(&name.0);
        }
        assert_eq!(table.original(first, all.len() as u32), None);
        assert!(model.geometries.insert(geometry.0, all).is_none());
        let own = run.model.instances[&first.0];
        model.instances.insert(first.0, Instance { geometry, transform: IDENTITY, ..own });
        run.reached.baked += u64::from(group.len() > 1);
    }
    assert_eq!(made.next(), None);
    for name in ordered.iter().flatten() {
        let geometry = run.model.instances[&name.0].geometry;
        if !model.instances.values().any(|own| own.geometry == geometry) {
            model.geometries.remove(&geometry.0);
        }
    }
    model.check(&baked);
    run.model.check(&run.scene);
    if !source.once_in(4) {
        model.other_instances = true;
        (run.scene, run.model) = (baked, model);
    }
}
