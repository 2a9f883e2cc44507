//! Which of the geometries that are not built a ray reaches.

use super::no_memory;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::scene::Asked;
use splitplane_core::ray::Ray;
use splitplane_core::scene::{
    GeometryId, GeometryMesh, InstanceId, ObjectSpace, Placement, Scene, SceneBuildError,
    SceneOptions, TopRay, TopStack, TopTree, WIDEST_STACK, WorldBox,
};
use splitplane_core::triangle::{Prepared, prepare};

/// The instances of what is not built.
#[derive(Default)]
pub(super) struct Reach {
    /// By instance.
    pub(super) placements: Vec<Option<Placement>>,
    pub(super) top: TopTree,
}

impl Reach {
    /// The instances of those geometries that wait.
    pub(super) fn of(
        scene: &Scene,
        waits: impl Fn(GeometryId) -> bool,
    ) -> Result<Reach, SceneBuildError> {
        let bounds: Vec<Option<Aabb>> = {
            let mut bounds = vec![None; scene.geometry_names()];
            for (name, mesh) in scene.geometries().filter(|(name, _)| waits(*name)) {
                bounds[name.0 as usize] = Some(bounds_of(mesh));
            }
            bounds
        };
        let mut placements: Vec<Option<Placement>> = vec![None; scene.instance_names()];
        let mut boxes: Vec<(u32, WorldBox)> = Vec::new();
        for (name, instance) in scene.instances() {
            let geometry = instance.geometry;
            let Some(bounds) = bounds[geometry.0 as usize] else { continue };
            // Checked when it was edited.
            let Some(space) = ObjectSpace::new(&instance.transform) else { continue };
            let has_shapes = scene.geometry(geometry).is_ok_and(|mesh| mesh.shapes().is_some());
            let placement = match has_shapes {
                true => Placement::of_shapes(instance, space, &bounds),
                false => Placement::new(instance, space, &bounds, None),
            };
            boxes.extend(placement.world_box.map(|own| (name.0, own)));
            placements[name.0 as usize] = Some(placement);
        }
        let top = TopTree::build(placements.len(), boxes.into_iter()).ok_or_else(no_memory)?;
        Ok(Reach { placements, top })
    }

    /// Shows the geometries that wait and that a ray reaches before `limit`, the nearest boxes first, as long as `show` wants more.
    pub(super) fn walk(
        &self,
        ray: &Ray,
        limit: f32,
        options: &SceneOptions<'_>,
        mut show: impl FnMut(GeometryId) -> bool,
    ) {
        let Some(ready) = TopRay::new(ray) else { return };
        let mut stack = [TopStack::default(); WIDEST_STACK];
        let mut top = self.top.begin(&mut stack);
        if limit == f32::NEG_INFINITY {
            return;
        }
        let t_max = ray.t_max.min(limit);
        while t_max >= ray.t_min
            && let Some(name) = self.top.next(&ready, t_max, &mut stack, &mut top)
        {
            let Some(Some(placement)) = self.placements.get(name as usize) else { continue };
            let answers = Asked::of(InstanceId(name), placement, options).is_some();
            if answers && !show(placement.instance.geometry) {
                return;
            }
        }
    }
}

/// The box of all that rays can meet, in the object's space.
fn bounds_of(mesh: &GeometryMesh) -> Aabb {
    if let Some(shapes) = mesh.shapes() {
        let all = (0..shapes.len() as u32).filter_map(|primitive| shapes.bounds(primitive));
        return all.fold(Aabb::EMPTY, |bounds, own| bounds.union(&own));
    }
    let mesh = mesh.mesh();
    (0..mesh.len()).fold(Aabb::EMPTY, |bounds, triangle| {
        let Prepared { corners, kept, .. } = prepare(&mesh.triangle(triangle));
        if kept { bounds.union(&Aabb::of_points(&corners)) } else { bounds }
    })
}
