//! Building a scene, and bringing it up to date: only what changed is made anew.

use alloc::boxed::Box;
use alloc::sync::Arc;
use alloc::vec::Vec;

use super::built::{BuildGeometry, BuiltGeometry, BuiltScene, host_only, repeated_bytes};
use super::lists::{lacking, push, reserve};
use super::packed::{GeometryChange, PackedSizes};
use super::repeats::Repeats;
use super::shared::SharedGeometry;
use crate::backend::BuildOptions;
use crate::cancel::go_on;
use crate::error::BuildError;
use crate::scene::{
    Changes, GeometryId, GeometryMesh, Instance, InstanceId, ObjectSpace, Placement, Scene,
    SceneBuildError, TopTree, WorldBox, top_tree_bytes,
};
use crate::watch::{Progress, Stage};

/// What became of the tree over the instances.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum TopUpdate {
    /// No box changed.
    #[default]
    Kept,
    /// The nodes above what moved have new boxes.
    Refitted,
    /// It was built anew: instances came or went, or rays through the old one had become too costly.
    Rebuilt,
}

/// What an update made anew.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct UpdateReport {
    /// Geometries that were built. Those that got the same arrays have one tree, and count each.
    pub geometries_built: u32,
    /// Geometries that were dropped.
    pub geometries_dropped: u32,
    /// Instances that were looked at, to find out whether they changed.
    pub instances_compared: u32,
    /// Instances that came, went, moved or changed otherwise, or whose geometry has other bounds.
    pub instances_changed: u32,
    /// What became of the tree over the instances.
    pub top: TopUpdate,
    /// Nodes of that tree that have new boxes.
    pub top_nodes_changed: u64,
    /// Bytes that were sent to a device besides the geometries' own trees: what changed of instances and of the tree over
    /// them, and of geometries those that are new or changed. All of them are sent where the scene was not on the device, or where more than half of the
    /// room there was free or had no place for what changed.
    pub bytes_sent: u64,
}

/// What a scene is going to be when an update ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Becoming<'a> {
    /// How long the arrays of its packed form are. If the tree over instances turns out worn, it may have other nodes in the end.
    pub sizes: PackedSizes,
    /// Geometries that change, in the order of their names. All others, and their opacity masks, stay what they are.
    pub changes: &'a [GeometryChange],
    /// Bytes that are held when the update is about to be put in place: the old scene, and beside it the new geometries, opacity masks that come, placements
    /// that change, and the new tree over instances.
    pub held: u64,
    /// What [`BuiltScene::host_only`] is going to say: with a reason there, a device needs no room.
    pub host_only: Option<&'static str>,
}

/// Instances that are placed between two calls of the watch.
const PLACED: usize = 4096;

/// What is going to change.
struct Plan {
    /// Geometries by name: a new one, or none any more.
    geometries: Vec<(GeometryId, Option<BuiltGeometry>)>,
    /// Placements by name, in ascending order.
    placements: Vec<(InstanceId, Option<Placement>)>,
    /// Bytes of the scene as it is and of the new geometries; 0 where there is no limit.
    held: u64,
    report: UpdateReport,
}

impl Plan {
    /// Bytes of the new geometries. A tree that several share counts once.
    fn new_bytes(&self) -> u64 {
        let new = || self.geometries.iter().flat_map(|(_, new)| new);
        new().map(BuiltGeometry::bytes).sum::<u64>().saturating_sub(repeated_bytes(new()))
    }

    /// Calls the watch, with all geometries built.
    fn go_on(&self, options: &BuildOptions<'_>) -> Result<(), SceneBuildError> {
        let done = u64::from(self.report.geometries_built);
        let progress = Progress { stage: Stage::Geometries, done, total: done };
        go_on(options.watch, progress).map_err(|_| SceneBuildError::Cancelled { progress })
    }

    /// Bytes of the planned placements.
    fn placement_bytes(&self) -> u64 {
        (self.placements.capacity() * size_of::<(InstanceId, Option<Placement>)>()) as u64
    }

    /// Whether what is held, the planned placements and so many bytes more are within the limit.
    fn check_limit(&self, more: u64, options: &BuildOptions<'_>) -> Result<(), SceneBuildError> {
        let Some(limit) = options.max_memory else { return Ok(()) };
        let needed = self.held + self.placement_bytes() + more;
        if needed > limit {
            return Err(SceneBuildError::OutOfMemory { needed, limit });
        }
        Ok(())
    }
}

impl BuiltScene {
    /// Builds a scene.
    ///
    /// # Errors
    /// A geometry that is not built, a limit that binds, or a watch that cancels the work.
    pub fn build(
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
    ) -> Result<BuiltScene, SceneBuildError> {
        let mut built = BuiltScene::default();
        built.update(scene, options, build)?;
        Ok(built)
    }

    /// Brings the scene up to date with its description, or with another one. Geometries are built anew where their arrays
    /// are not those they were built over, whatever the options say now; of instances only those that changed are looked at,
    /// where the description knows. After an error the scene is what it was.
    ///
    /// # Errors
    /// As for [`BuiltScene::build`]. New geometries are held beside the old ones, and count together with them towards the limit.
    pub fn update(
        &mut self,
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        self.update_planned(scene, options, build, |_, _, _| Ok(()))
    }

    /// [`BuiltScene::update`] for a backend that holds the scene elsewhere too: `reserve` is called when all that can fail is done and
    /// nothing has changed yet, with what the scene is going to be. Its error ends the update.
    ///
    /// # Errors
    /// As for [`BuiltScene::update`], and those of `reserve`.
    pub fn update_after(
        &mut self,
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
        reserve: &mut dyn FnMut(&Becoming<'_>) -> Result<(), SceneBuildError>,
    ) -> Result<UpdateReport, SceneBuildError> {
        self.update_planned(scene, options, build, |own, plan, rebuilt| {
            reserve(&own.becoming(scene, plan, rebuilt, &own.changes(scene, plan)?))
        })
    }

    /// Updates, and calls `reserve` with the plan and the new tree over instances when all that can fail is done.
    fn update_planned(
        &mut self,
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
        reserve: impl FnOnce(&BuiltScene, &Plan, Option<&TopTree>) -> Result<(), SceneBuildError>,
    ) -> Result<UpdateReport, SceneBuildError> {
        let mut plan = self.build_geometries(scene, options, build)?;
        plan.go_on(options)?;
        self.place_instances(scene, &mut plan, options)?;
        // Masks have not been counted yet. Fewer than a few thousand placements count only together with them, or where instances come or go: alone
        // they are not worth a refusal.
        let masks = self.new_mask_bytes(scene);
        if masks > 0 {
            plan.check_limit(masks, options)?;
        }
        let rebuilt = self.rebuilt_top(scene, &plan, options)?;
        make_room(&mut self.geometries, scene.geometry_names())?;
        make_room(&mut self.placements, scene.instance_names())?;
        reserve(self, &plan, rebuilt.as_ref())?;

        // Nothing fails from here on, but for a worn tree that is then kept.
        let Plan { geometries, placements, mut report, .. } = plan;
        if !geometries.is_empty() {
            for (name, geometry) in geometries {
                self.geometries[name.0 as usize] = geometry;
            }
            self.repeated = repeated_bytes(self.geometries.iter().flatten());
        }
        self.masked = false;
        for (name, _) in scene.geometries() {
            if let Some(Some(own)) = self.geometries.get_mut(name.0 as usize) {
                own.opacity = scene.opacity(name).ok().flatten().cloned();
                self.masked |= own.opacity.is_some();
            }
        }
        self.forget_nearness();
        report.instances_changed = placements.len() as u32;
        if let Some(top) = rebuilt {
            report.top = TopUpdate::Rebuilt;
            report.top_nodes_changed = top.nodes().len() as u64;
            self.top = top;
        } else {
            for (name, placement) in &placements {
                if let Some(Placement { world_box: Some(to), .. }) = placement {
                    report.top_nodes_changed += self.top.move_to(name.0, to) as u64;
                }
            }
            if report.top_nodes_changed > 0 {
                report.top = TopUpdate::Refitted;
            }
        }
        for (name, placement) in placements {
            self.placements[name.0 as usize] = placement;
        }
        self.edits = Some(scene.edits());
        let room = top_tree_bytes(scene.len(), scene.instance_names())
            + (scene.len() * size_of::<(u32, WorldBox)>()) as u64;
        if self.top.is_worn()
            && options.max_memory.is_none_or(|limit| self.bytes() + room <= limit)
            && let Ok(top) = self.top_of(scene.instance_names(), &[])
        {
            report.top = TopUpdate::Rebuilt;
            report.top_nodes_changed += top.nodes().len() as u64;
            self.top = top;
        }
        Ok(report)
    }

    /// The geometries that change, in the order of their names.
    fn changes(&self, scene: &Scene, plan: &Plan) -> Result<Vec<GeometryChange>, SceneBuildError> {
        let opacity = |name| scene.opacity(name).ok().flatten();
        let mut changes = Vec::new();
        for (geometry, new) in &plan.geometries {
            let opacity = opacity(*geometry).map(|mask| &**mask);
            let sizes = new.as_ref().map(|own| PackedSizes::default().and(own, opacity));
            push(&mut changes, GeometryChange { geometry: *geometry, sizes })?;
        }
        for (geometry, own) in self.kept(plan) {
            let new = opacity(geometry);
            if own.opacity.as_ref().map(Arc::as_ptr) != new.map(Arc::as_ptr) {
                let sizes = Some(PackedSizes::default().and(own, new.map(|mask| &**mask)));
                push(&mut changes, GeometryChange { geometry, sizes })?;
            }
        }
        changes.sort_unstable_by_key(|change| change.geometry);
        Ok(changes)
    }

    /// Geometries that are neither replaced nor dropped.
    fn kept<'a>(
        &'a self,
        plan: &'a Plan,
    ) -> impl Iterator<Item = (GeometryId, &'a BuiltGeometry)> + 'a {
        let planned = |name| plan.geometries.binary_search_by_key(&name, |&(name, _)| name).is_ok();
        self.geometries().filter(move |(name, _)| !planned(*name))
    }

    /// What the scene is going to be.
    fn becoming<'a>(
        &self,
        scene: &Scene,
        plan: &Plan,
        rebuilt: Option<&TopTree>,
        changes: &'a [GeometryChange],
    ) -> Becoming<'a> {
        let kept = || self.kept(plan);
        let new = plan.geometries.iter().filter_map(|(name, own)| Some((*name, own.as_ref()?)));
        let opacity = |name| scene.opacity(name).ok().flatten();
        let sizes = PackedSizes {
            top_nodes: rebuilt.unwrap_or(&self.top).nodes().len(),
            instances: self.placements.len(),
            ..PackedSizes::default()
        };
        let held = self.bytes()
            + plan.new_bytes()
            + plan.placement_bytes()
            + self.new_mask_bytes(scene)
            + rebuilt.map_or(0, TopTree::bytes);
        let has_own_shapes = kept().chain(new.clone()).any(|(_, own)| own.has_own_shapes());
        Becoming {
            host_only: host_only(has_own_shapes),
            changes,
            sizes: kept().chain(new).fold(sizes, |sizes, (name, own)| {
                sizes.and(own, opacity(name).map(|mask| &**mask))
            }),
            held,
        }
    }

    /// Builds the geometries whose arrays are new, and finds those that are gone.
    fn build_geometries(
        &self,
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
    ) -> Result<Plan, SceneBuildError> {
        let mut geometries = Vec::new();
        let mut report = UpdateReport::default();
        let total = self.new_geometries(scene).count();
        let repeats = Repeats::of(self.new_geometries(scene))?;
        let was = if options.max_memory.is_some() { self.bytes() } else { 0 };
        let mut held = was;
        for (name, mesh) in self.new_geometries(scene) {
            let done = u64::from(report.geometries_built);
            let progress = Progress { stage: Stage::Geometries, done, total: total as u64 };
            go_on(options.watch, progress).map_err(|_| SceneBuildError::Cancelled { progress })?;
            // Whoever set a limit reads of that limit, and of all that counts towards it.
            let wrong = |error| match error {
                BuildError::Cancelled { .. } => SceneBuildError::Cancelled { progress },
                error => {
                    let error = BuildError::beside(error, held, options.max_memory);
                    SceneBuildError::Geometry { geometry: name.0, error }
                }
            };
            let own = options.beside(held);
            let first = repeats.first_of(mesh);
            let built = if mesh.shapes().is_some() {
                BuiltGeometry::of_shapes(Arc::clone(mesh), own.max_memory).map_err(wrong)?
            } else if let Some(tree) = first.and_then(|first| tree_again(&mut geometries, first)) {
                BuiltGeometry::new(Arc::clone(mesh), Box::new(tree))
            } else {
                let mut built = build(&mesh.mesh(), &own).map_err(wrong)?;
                if first.is_some() && built.downcast_mut::<SharedGeometry>().is_none() {
                    built = Box::new(SharedGeometry::new(Arc::clone(mesh), built));
                }
                BuiltGeometry::new(Arc::clone(mesh), built)
            };
            held += built.uncounted_bytes();
            push(&mut geometries, (name, Some(built)))?;
            report.geometries_built += 1;
        }
        for (name, _) in self.geometries() {
            if scene.geometry(name).is_err() {
                push(&mut geometries, (name, None))?;
                report.geometries_dropped += 1;
            }
        }
        // In ascending order, to be found.
        geometries.sort_unstable_by_key(|&(name, _)| name);
        let mut plan = Plan { geometries, placements: Vec::new(), held: was, report };
        if options.max_memory.is_some() {
            plan.held += plan.new_bytes();
        }
        Ok(plan)
    }

    /// The geometries of a description that an update to it builds, in the order in which it asks for them, those of shapes left out: for backends that
    /// build them before. Of those that get the same arrays it is the first: the others have its tree.
    ///
    /// # Errors
    /// No memory.
    pub fn unbuilt<'a>(
        &'a self,
        scene: &'a Scene,
    ) -> Result<impl Iterator<Item = (GeometryId, &'a Arc<GeometryMesh>)> + 'a, SceneBuildError>
    {
        let repeats = Repeats::of(self.new_geometries(scene))?;
        let new = self.new_geometries(scene).filter(|(_, mesh)| mesh.shapes().is_none());
        Ok(new.filter(move |(name, mesh)| repeats.first_of(mesh).is_none_or(|one| one == *name)))
    }

    /// The geometries of a description that are not built, in the order of their names.
    fn new_geometries<'a>(
        &'a self,
        scene: &'a Scene,
    ) -> impl Iterator<Item = (GeometryId, &'a Arc<GeometryMesh>)> + 'a {
        scene.geometries().filter(|&(name, mesh)| self.is_new(name, mesh))
    }

    /// Whether a geometry is not built over these arrays.
    fn is_new(&self, name: GeometryId, mesh: &Arc<GeometryMesh>) -> bool {
        self.geometry(name).is_none_or(|own| !Arc::ptr_eq(&own.mesh, mesh))
    }

    /// Places the instances that changed.
    fn place_instances(
        &self,
        scene: &Scene,
        plan: &mut Plan,
        options: &BuildOptions<'_>,
    ) -> Result<(), SceneBuildError> {
        let moved = plan.geometries.iter().any(|(name, geometry)| {
            let extents = |geometry: &BuiltGeometry| {
                (geometry.bounds(), geometry.outline().copied(), geometry.shapes().is_some())
            };
            geometry.as_ref().map(extents) != self.geometry(*name).map(extents)
        });
        let changes = match &self.edits {
            Some(edits) if !moved => scene.changes_since(edits),
            _ => Changes::Unknown,
        };
        if let Changes::These(names) = changes {
            let mut names: Vec<InstanceId> = {
                let mut own = Vec::new();
                reserve(&mut own, names.len())?;
                own.extend_from_slice(names);
                own
            };
            names.sort_unstable();
            names.dedup();
            return self.place_all(scene, names.into_iter(), plan, options);
        }
        let names = scene.instance_names().max(self.placements.len()) as u32;
        if self.placements.is_empty() {
            // All are new: a list that grows would be copied again and again.
            reserve(&mut plan.placements, scene.len())?;
        }
        self.place_all(scene, (0..names).map(InstanceId), plan, options)
    }

    /// Places these instances, where they changed. The watch is called between every few thousand of them.
    fn place_all(
        &self,
        scene: &Scene,
        names: impl Iterator<Item = InstanceId>,
        plan: &mut Plan,
        options: &BuildOptions<'_>,
    ) -> Result<(), SceneBuildError> {
        for (place, name) in names.enumerate() {
            if place > 0 && place % PLACED == 0 {
                plan.go_on(options)?;
                plan.check_limit(0, options)?;
            }
            self.place(scene, name, plan)?;
        }
        Ok(())
    }

    /// Bytes of the opacity masks of a description that the scene has not. Those that it loses count until it has lost them.
    fn new_mask_bytes(&self, scene: &Scene) -> u64 {
        let new = |(name, _)| {
            let mask = scene.opacity(name).ok().flatten()?;
            let had = self.geometry(name).and_then(|own| own.opacity.as_ref());
            let same = had.is_some_and(|had| Arc::ptr_eq(had, mask));
            (!same).then(|| size_of_val(mask.words()) as u64)
        };
        scene.geometries().filter_map(new).sum()
    }

    /// Places an instance, where it changed.
    fn place(
        &self,
        scene: &Scene,
        name: InstanceId,
        plan: &mut Plan,
    ) -> Result<(), SceneBuildError> {
        plan.report.instances_compared += 1;
        let was = self.placement(name);
        let Ok(instance) = scene.instance(name) else {
            return if was.is_some() { push(&mut plan.placements, (name, None)) } else { Ok(()) };
        };
        // Built when it was added.
        let Some(geometry) = self.geometry_of(instance, plan) else { return Ok(()) };
        let (bounds, outline) = (geometry.bounds(), geometry.outline());
        let geometry_was = self.geometry(instance.geometry);
        let outline_was = geometry_was.and_then(BuiltGeometry::outline);
        let same_kind =
            geometry_was.is_some_and(|was| was.shapes().is_some() == geometry.shapes().is_some());
        if let Some(was) = was
            && was.instance == *instance
            && was.bounds == bounds
            && outline == outline_was
            && same_kind
            // Zeros of either sign are equal, but the digest knows them apart.
            && bits(&was.instance.transform) == bits(&instance.transform)
        {
            return Ok(());
        }
        // Checked when it was edited.
        let Some((space, defect)) = ObjectSpace::with_defect(&instance.transform) else {
            return Ok(());
        };
        let placement = geometry.place(instance, (space, &defect));
        push(&mut plan.placements, (name, Some(placement)))
    }

    /// The geometry that an instance is going to have.
    fn geometry_of<'a>(&'a self, instance: &Instance, plan: &'a Plan) -> Option<&'a BuiltGeometry> {
        let at = plan.geometries.binary_search_by_key(&instance.geometry, |&(name, _)| name);
        match at {
            Ok(at) => plan.geometries[at].1.as_ref(),
            Err(_) => self.geometry(instance.geometry),
        }
    }

    /// The tree over the instances that are going to be, where some come or go.
    fn rebuilt_top(
        &self,
        scene: &Scene,
        plan: &Plan,
        options: &BuildOptions<'_>,
    ) -> Result<Option<TopTree>, SceneBuildError> {
        let is_there = |placement: &Option<Placement>| {
            placement.as_ref().is_some_and(|placement| placement.world_box.is_some())
        };
        let same =
            plan.placements.iter().all(|(name, becomes)| self.top.has(name.0) == is_there(becomes));
        if same {
            return Ok(None);
        }
        if options.max_memory.is_some() {
            let names = scene.instance_names();
            let placements = (names * size_of::<Option<Placement>>()) as u64;
            // What is held until the new placements take their places, and the list that the tree is built from.
            let boxes = (scene.len() * size_of::<(u32, WorldBox)>()) as u64;
            let more = placements + boxes + top_tree_bytes(scene.len(), names);
            plan.check_limit(more, options)?;
        }
        self.top_of(scene.instance_names(), &plan.placements).map(Some)
    }

    /// The tree over placements, some of which are replaced: those are in ascending order.
    fn top_of(
        &self,
        names: usize,
        replaced: &[(InstanceId, Option<Placement>)],
    ) -> Result<TopTree, SceneBuildError> {
        let mut boxes: Vec<(u32, WorldBox)> = Vec::new();
        reserve(&mut boxes, replaced.len())?;
        let mut next = replaced.iter().peekable();
        for name in 0..names.max(self.placements.len()) as u32 {
            let placement = match next.next_if(|(replaced, _)| replaced.0 == name) {
                Some((_, becomes)) => becomes.as_ref(),
                None => self.placement(InstanceId(name)),
            };
            if let Some(Placement { world_box: Some(own), .. }) = placement {
                push(&mut boxes, (name, *own))?;
            }
        }
        let bytes = top_tree_bytes(boxes.len(), names);
        TopTree::build(names, boxes.into_iter()).ok_or_else(|| lacking(bytes))
    }
}

/// The tree of a geometry that this update built already, for another one with the same arrays; it counts once.
fn tree_again(
    built: &mut [(GeometryId, Option<BuiltGeometry>)],
    name: GeometryId,
) -> Option<SharedGeometry> {
    let place = built.binary_search_by_key(&name, |&(name, _)| name).ok()?;
    let own = built[place].1.as_mut()?;
    Some(own.accelerator.downcast_mut::<SharedGeometry>()?.again())
}

fn bits(transform: &[[f32; 4]; 3]) -> [[u32; 4]; 3] {
    transform.map(|row| row.map(f32::to_bits))
}

/// Makes a place for each name.
fn make_room<T>(list: &mut Vec<Option<T>>, names: usize) -> Result<(), SceneBuildError> {
    if list.len() < names {
        reserve(list, names - list.len())?;
        list.resize_with(names, || None);
    }
    Ok(())
}
