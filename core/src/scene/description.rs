//! The description of a scene, which its user edits.

use alloc::sync::Arc;
use alloc::vec::Vec;

use super::error::SceneError;
use super::hit::{GeometryId, InstanceId, MAX_INSTANCES};
use super::opacity::OpacityMask;
use super::shape::Shapes;
use super::transform::{IDENTITY, ObjectSpace, Transform};
use crate::mesh::Mesh;
use crate::ray::Culling;

/// An instance: a geometry, placed in the world.
// What queries read comes first: see `Placement`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// The geometry.
    pub geometry: GeometryId,
    /// Rays enter the instance when a bit of theirs is in this mask.
    pub mask: u32,
    /// The side of its triangles that this instance ignores, whatever the query; seen in the world.
    pub culling: Culling,
    /// A number of the user's, which means nothing here.
    pub id: u32,
    /// From the object's space to the world.
    pub transform: Transform,
}

impl Instance {
    /// An instance that lets nothing be ignored: all bits of the mask, no culling, number 0.
    pub const fn new(geometry: GeometryId, transform: Transform) -> Instance {
        Instance { geometry, transform, mask: u32::MAX, id: 0, culling: Culling::None }
    }

    /// The geometry where it is.
    pub const fn in_place(geometry: GeometryId) -> Instance {
        Instance::new(geometry, IDENTITY)
    }
}

/// What a geometry consists of: the arrays of a mesh, or shapes.
#[derive(Debug)]
pub struct GeometryMesh {
    positions: Vec<[f32; 3]>,
    indices: Option<Vec<[u32; 3]>>,
    shapes: Option<Shapes>,
}

impl GeometryMesh {
    fn copied(mesh: &Mesh<'_>) -> Result<GeometryMesh, SceneError> {
        let (positions, indices) = mesh.arrays();
        Ok(GeometryMesh {
            positions: copied(positions)?,
            indices: indices.map(copied).transpose()?,
            shapes: None,
        })
    }

    fn of_shapes(shapes: Shapes) -> Result<GeometryMesh, SceneError> {
        let primitives = shapes.len() as u64;
        if primitives >= MAX_INSTANCES as u64 {
            return Err(SceneError::TooManyPrimitives { primitives });
        }
        Ok(GeometryMesh { positions: Vec::new(), indices: None, shapes: Some(shapes) })
    }

    /// The shapes; `None` for a mesh.
    pub fn shapes(&self) -> Option<&Shapes> {
        self.shapes.as_ref()
    }

    /// What it consists of, in the plural.
    pub fn kind_name(&self) -> &'static str {
        self.shapes.as_ref().map_or("triangles", Shapes::name)
    }

    /// The mesh; one without triangles for shapes.
    pub fn mesh(&self) -> Mesh<'_> {
        Mesh::of_checked(&self.positions, self.indices.as_deref())
    }
}

fn copied<T: Copy>(slice: &[T]) -> Result<Vec<T>, SceneError> {
    let mut own = Vec::new();
    reserve(&mut own, slice.len())?;
    own.extend_from_slice(slice);
    Ok(own)
}

pub(super) fn reserve<T>(list: &mut Vec<T>, more: usize) -> Result<(), SceneError> {
    let bytes = more.saturating_mul(size_of::<T>()) as u64;
    list.try_reserve(more).map_err(|_| SceneError::OutOfMemory { bytes })
}

/// Which instances changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Changes<'a> {
    /// At most these; one may be named several times.
    These(&'a [InstanceId]),
    /// Any may have.
    Unknown,
}

/// The edits of instances since some time, as many as are worth keeping.
#[derive(Debug, Default)]
struct EditLog {
    /// Edits before those that are kept.
    before: u64,
    kept: Vec<InstanceId>,
}

/// Where a scene was in its edits, for who wants to know what changed since.
#[derive(Clone, Debug)]
pub struct Edits {
    scene: Arc<()>,
    count: u64,
}

impl Edits {
    /// Whether both are the same time of the same scene.
    pub(crate) fn is_same(&self, other: &Edits) -> bool {
        Arc::ptr_eq(&self.scene, &other.scene) && self.count == other.count
    }
}

/// A geometry of a scene and how many instances it has.
#[derive(Debug)]
struct Geometry {
    mesh: Arc<GeometryMesh>,
    opacity: Option<Arc<OpacityMask>>,
    instances: u32,
}

impl Geometry {
    fn check_kind(
        &self,
        geometry: GeometryId,
        given: &'static str,
        fits: bool,
    ) -> Result<(), SceneError> {
        let (geometry, has) = (geometry.0, self.mesh.kind_name());
        if fits { Ok(()) } else { Err(SceneError::OtherKind { geometry, has, given }) }
    }

    fn new(mesh: GeometryMesh) -> Geometry {
        Geometry { mesh: Arc::new(mesh), opacity: None, instances: 0 }
    }
}

/// A geometry for [`Scene::of_checked`].
pub(super) struct Checked<'a> {
    pub(super) mesh: Mesh<'a>,
    pub(super) shapes: Option<Shapes>,
    pub(super) opacity: Option<OpacityMask>,
}

/// What is at the place of a name.
#[derive(Clone, Debug)]
pub enum State<T> {
    /// Something.
    There(T),
    /// Nothing; the place will be used again.
    Free,
}

impl<T> State<T> {
    /// What is there, if anything.
    pub const fn there(&self) -> Option<&T> {
        match self {
            State::There(it) => Some(it),
            State::Free => None,
        }
    }
}

/// A description of many objects. It has its own copies of the meshes, and the shapes that it was given.
///
/// ```
/// use splitplane_core::mesh::Mesh;
/// use splitplane_core::scene::{Instance, Scene, translation};
///
/// let triangle = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
/// let mut scene = Scene::new();
/// let geometry = scene.add_mesh(&Mesh::soup(&triangle).unwrap()).unwrap();
/// let instance = scene.add_instance(Instance::in_place(geometry)).unwrap();
/// scene.move_instance(instance, translation([0.0, 0.0, 2.0])).unwrap();
/// ```
#[derive(Debug, Default)]
pub struct Scene {
    geometries: Vec<State<Geometry>>,
    free_geometries: Vec<u32>,
    instances: Vec<State<Instance>>,
    free_instances: Vec<u32>,
    /// Instances that are there.
    count: usize,
    identity: Arc<()>,
    log: EditLog,
}

impl Scene {
    /// A scene without anything.
    pub fn new() -> Scene {
        Scene::default()
    }

    /// A scene of these geometries and instances, by their names; what is `None` is free. Transforms and geometries of
    /// instances have been checked. Of free names the least will be given first.
    pub(super) fn of_checked<'a>(
        geometries: impl ExactSizeIterator<Item = Result<Option<Checked<'a>>, SceneError>>,
        instances: impl ExactSizeIterator<Item = Option<Instance>>,
    ) -> Result<Scene, SceneError> {
        let mut scene = Scene::new();
        reserve(&mut scene.geometries, geometries.len())?;
        for geometry in geometries {
            scene.geometries.push(match geometry? {
                Some(Checked { mesh, shapes, opacity }) => {
                    let mut own = Geometry::new(match shapes {
                        Some(shapes) => GeometryMesh::of_shapes(shapes)?,
                        None => GeometryMesh::copied(&mesh)?,
                    });
                    own.opacity = opacity.map(Arc::new);
                    State::There(own)
                }
                None => State::Free,
            });
        }
        reserve(&mut scene.instances, instances.len())?;
        for instance in instances {
            if let Some(instance) = &instance {
                scene.geometry_mut(instance.geometry)?.instances += 1;
                scene.count += 1;
            }
            scene.instances.push(instance.map_or(State::Free, State::There));
        }
        scene.free_geometries = free_names(&scene.geometries)?;
        scene.free_instances = free_names(&scene.instances)?;
        Ok(scene)
    }

    /// Another description of the same, which shares all arrays with this one.
    pub(super) fn shared_copy(&self) -> Result<Scene, SceneError> {
        let mut own = Scene { count: self.count, ..Scene::new() };
        reserve(&mut own.geometries, self.geometries.len())?;
        own.geometries.extend(self.geometries.iter().map(|at| match at {
            State::There(Geometry { mesh, opacity, instances }) => State::There(Geometry {
                mesh: Arc::clone(mesh),
                opacity: opacity.clone(),
                instances: *instances,
            }),
            State::Free => State::Free,
        }));
        reserve(&mut own.instances, self.instances.len())?;
        own.instances.extend(self.instances.iter().cloned());
        own.free_geometries = copied(&self.free_geometries)?;
        own.free_instances = copied(&self.free_instances)?;
        Ok(own)
    }

    /// Adds a geometry: a copy of a mesh.
    ///
    /// # Errors
    /// Too many geometries, or no memory for it.
    pub fn add_mesh(&mut self, mesh: &Mesh<'_>) -> Result<GeometryId, SceneError> {
        self.add(|| GeometryMesh::copied(mesh))
    }

    /// Adds a geometry of arrays that are a mesh.
    pub(super) fn add_arrays(
        &mut self,
        positions: Vec<[f32; 3]>,
        indices: Vec<[u32; 3]>,
    ) -> Result<GeometryId, SceneError> {
        self.add(|| Ok(GeometryMesh { positions, indices: Some(indices), shapes: None }))
    }

    /// Adds a geometry of shapes.
    ///
    /// # Errors
    /// Too many geometries, or too many shapes.
    pub fn add_shapes(&mut self, shapes: Shapes) -> Result<GeometryId, SceneError> {
        self.add(|| GeometryMesh::of_shapes(shapes))
    }

    fn add(
        &mut self,
        own: impl FnOnce() -> Result<GeometryMesh, SceneError>,
    ) -> Result<GeometryId, SceneError> {
        let place = next_place(&mut self.geometries, &self.free_geometries)
            .ok_or(SceneError::TooManyGeometries)??;
        fill(&mut self.geometries, &mut self.free_geometries, Geometry::new(own()?));
        Ok(GeometryId(place))
    }

    /// Gives a geometry another mesh; its instances stay, and its opacity mask does where it has as many triangles.
    ///
    /// # Errors
    /// No such geometry, one of shapes, or no memory for the mesh.
    pub fn replace_mesh(
        &mut self,
        geometry: GeometryId,
        mesh: &Mesh<'_>,
    ) -> Result<(), SceneError> {
        let own = self.geometry_mut(geometry)?;
        own.check_kind(geometry, "triangles", own.mesh.shapes.is_none())?;
        own.mesh = Arc::new(GeometryMesh::copied(mesh)?);
        let triangles = mesh.len();
        own.opacity = own.opacity.take().filter(|mask| mask.triangles() as usize == triangles);
        Ok(())
    }

    /// Gives a geometry of shapes another set of any kind; its instances stay.
    ///
    /// # Errors
    /// No such geometry, one of triangles, or too many shapes.
    pub fn replace_shapes(
        &mut self,
        geometry: GeometryId,
        shapes: Shapes,
    ) -> Result<(), SceneError> {
        let own = self.geometry_mut(geometry)?;
        own.check_kind(geometry, shapes.name(), own.mesh.shapes.is_some())?;
        own.mesh = Arc::new(GeometryMesh::of_shapes(shapes)?);
        Ok(())
    }

    /// Makes a geometry the same as one of another description, of any kind: both share its arrays, so what was built over them for the one
    /// is known to be built for the other. Opacity masks are shared too. Instances stay.
    ///
    /// # Errors
    /// No such geometry, here or there.
    pub fn share_geometry(
        &mut self,
        geometry: GeometryId,
        from: &Scene,
        there: GeometryId,
    ) -> Result<(), SceneError> {
        let (mesh, opacity) = (from.geometry(there)?.clone(), from.opacity(there)?.cloned());
        let own = self.geometry_mut(geometry)?;
        (own.mesh, own.opacity) = (mesh, opacity);
        Ok(())
    }

    /// Says which parts of a geometry's triangles count for rays; `None`: all do. Nothing is built for it. Points inside and closest
    /// points are those of the whole mesh.
    ///
    /// # Errors
    /// No such geometry, or a mask of another number of triangles, as for shapes, which have none.
    pub fn set_opacity(
        &mut self,
        geometry: GeometryId,
        mask: Option<OpacityMask>,
    ) -> Result<(), SceneError> {
        let own = self.geometry_mut(geometry)?;
        let triangles = own.mesh.mesh().len() as u32;
        if let Some(mask) = &mask
            && (mask.triangles() != triangles || own.mesh.shapes.is_some())
        {
            let (geometry, mask) = (geometry.0, mask.triangles());
            return Err(SceneError::OpacityTriangles { geometry, triangles, mask });
        }
        own.opacity = mask.map(Arc::new);
        Ok(())
    }

    /// The opacity mask of a geometry; `None` where all of it counts.
    ///
    /// # Errors
    /// No such geometry.
    pub fn opacity(&self, geometry: GeometryId) -> Result<Option<&Arc<OpacityMask>>, SceneError> {
        match self.geometries.get(geometry.0 as usize).and_then(State::there) {
            Some(own) => Ok(own.opacity.as_ref()),
            None => Err(SceneError::UnknownGeometry { geometry: geometry.0 }),
        }
    }

    /// Removes a geometry.
    ///
    /// # Errors
    /// No such geometry, or one that has instances.
    pub fn remove_geometry(&mut self, geometry: GeometryId) -> Result<(), SceneError> {
        let instances = self.geometry_mut(geometry)?.instances;
        if instances > 0 {
            let first = self.instances().find(|(_, instance)| instance.geometry == geometry);
            return Err(SceneError::GeometryInUse {
                geometry: geometry.0,
                instances,
                instance: first.map_or(u32::MAX, |(instance, _)| instance.0),
            });
        }
        reserve(&mut self.free_geometries, 1)?;
        self.free_geometries.push(geometry.0);
        self.geometries[geometry.0 as usize] = State::Free;
        Ok(())
    }

    /// Whether a geometry is there and has no instances, in one step.
    pub(super) fn is_unused(&self, geometry: GeometryId) -> bool {
        let own = self.geometries.get(geometry.0 as usize).and_then(State::there);
        own.is_some_and(|own| own.instances == 0)
    }

    /// Adds an instance.
    ///
    /// # Errors
    /// No such geometry, a transform that is not finite or has no inverse, too many instances, or no memory.
    pub fn add_instance(&mut self, instance: Instance) -> Result<InstanceId, SceneError> {
        self.geometry_mut(instance.geometry)?;
        let place = next_place(&mut self.instances, &self.free_instances)
            .ok_or(SceneError::TooManyInstances)??;
        check(place, &instance.transform)?;
        self.note(InstanceId(place))?;
        fill(&mut self.instances, &mut self.free_instances, instance);
        self.geometry_mut(instance.geometry)?.instances += 1;
        self.count += 1;
        Ok(InstanceId(place))
    }

    /// Removes an instance.
    ///
    /// # Errors
    /// No such instance.
    pub fn remove_instance(&mut self, instance: InstanceId) -> Result<(), SceneError> {
        let geometry = self.instance(instance)?.geometry;
        reserve(&mut self.free_instances, 1)?;
        self.note(instance)?;
        self.geometry_mut(geometry)?.instances -= 1;
        self.free_instances.push(instance.0);
        self.instances[instance.0 as usize] = State::Free;
        self.count -= 1;
        Ok(())
    }

    /// Moves an instance: from now on this is its transform.
    ///
    /// # Errors
    /// No such instance, or a transform that is not finite or has no inverse.
    pub fn move_instance(
        &mut self,
        instance: InstanceId,
        transform: Transform,
    ) -> Result<(), SceneError> {
        self.set_instance(instance, Instance { transform, ..*self.instance(instance)? })
    }

    /// Gives an instance another mask.
    ///
    /// # Errors
    /// No such instance.
    pub fn set_mask(&mut self, instance: InstanceId, mask: u32) -> Result<(), SceneError> {
        self.set_instance(instance, Instance { mask, ..*self.instance(instance)? })
    }

    /// Replaces all that an instance is, its geometry included.
    ///
    /// # Errors
    /// No such instance or geometry, or a transform that is not finite or has no inverse.
    pub fn set_instance(
        &mut self,
        instance: InstanceId,
        becomes: Instance,
    ) -> Result<(), SceneError> {
        let was = *self.instance(instance)?;
        self.geometry_mut(becomes.geometry)?;
        if becomes.transform != was.transform {
            check(instance.0, &becomes.transform)?;
        }
        self.note(instance)?;
        self.geometry_mut(was.geometry)?.instances -= 1;
        self.geometry_mut(becomes.geometry)?.instances += 1;
        self.instances[instance.0 as usize] = State::There(becomes);
        Ok(())
    }

    /// An instance.
    ///
    /// # Errors
    /// No such instance.
    pub fn instance(&self, instance: InstanceId) -> Result<&Instance, SceneError> {
        let place = self.instances.get(instance.0 as usize).and_then(State::there);
        place.ok_or(SceneError::UnknownInstance { instance: instance.0 })
    }

    /// The arrays of a geometry, which do not change as long as anybody holds them.
    ///
    /// # Errors
    /// No such geometry.
    pub fn geometry(&self, geometry: GeometryId) -> Result<&Arc<GeometryMesh>, SceneError> {
        match self.geometries.get(geometry.0 as usize).and_then(State::there) {
            Some(own) => Ok(&own.mesh),
            None => Err(SceneError::UnknownGeometry { geometry: geometry.0 }),
        }
    }

    fn geometry_mut(&mut self, geometry: GeometryId) -> Result<&mut Geometry, SceneError> {
        match self.geometries.get_mut(geometry.0 as usize) {
            Some(State::There(own)) => Ok(own),
            _ => Err(SceneError::UnknownGeometry { geometry: geometry.0 }),
        }
    }

    /// All instances, in the order of their names.
    pub fn instances(&self) -> impl Iterator<Item = (InstanceId, &Instance)> {
        let named = self.instances.iter().enumerate();
        named.filter_map(|(name, at)| Some((InstanceId(name as u32), at.there()?)))
    }

    /// All geometries, in the order of their names.
    pub fn geometries(&self) -> impl Iterator<Item = (GeometryId, &Arc<GeometryMesh>)> {
        let named = self.geometries.iter().enumerate();
        named.filter_map(|(name, at)| Some((GeometryId(name as u32), &at.there()?.mesh)))
    }

    /// How many instances there are.
    pub const fn len(&self) -> usize {
        self.count
    }

    /// True for a scene without instances.
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// One more than the greatest name that an instance has had.
    pub fn instance_names(&self) -> usize {
        self.instances.len()
    }

    /// One more than the greatest name that a geometry has had.
    pub fn geometry_names(&self) -> usize {
        self.geometries.len()
    }

    /// The present, for [`Scene::changes_since`].
    pub fn edits(&self) -> Edits {
        Edits { scene: Arc::clone(&self.identity), count: self.log.now() }
    }

    /// Which instances changed since then.
    pub fn changes_since(&self, then: &Edits) -> Changes<'_> {
        if !Arc::ptr_eq(&self.identity, &then.scene) || then.count < self.log.before {
            return Changes::Unknown;
        }
        match self.log.kept.get((then.count - self.log.before) as usize..) {
            Some(changed) => Changes::These(changed),
            None => Changes::Unknown,
        }
    }

    /// Notes that an instance changes.
    fn note(&mut self, instance: InstanceId) -> Result<(), SceneError> {
        // More than this is no less work than to look at all instances.
        if self.log.kept.len() >= self.instances.len().max(64) {
            self.log.before += self.log.kept.len() as u64;
            self.log.kept.clear();
        }
        reserve(&mut self.log.kept, 1)?;
        self.log.kept.push(instance);
        Ok(())
    }
}

impl EditLog {
    fn now(&self) -> u64 {
        self.before + self.kept.len() as u64
    }
}

/// The next free place, with room for what will be there; `None` where there are too many.
fn next_place<T>(places: &mut Vec<State<T>>, free: &[u32]) -> Option<Result<u32, SceneError>> {
    if let Some(&place) = free.last() {
        return Some(Ok(place));
    }
    if places.len() >= MAX_INSTANCES {
        return None;
    }
    Some(reserve(places, 1).map(|()| places.len() as u32))
}

/// The places where nothing is, the least last, which is the next to be used.
fn free_names<T>(places: &[State<T>]) -> Result<Vec<u32>, SceneError> {
    let mut free = Vec::new();
    for (place, at) in places.iter().enumerate().rev() {
        if at.there().is_none() {
            reserve(&mut free, 1)?;
            free.push(place as u32);
        }
    }
    Ok(free)
}

/// Puts something at the next free place.
fn fill<T>(places: &mut Vec<State<T>>, free: &mut Vec<u32>, it: T) {
    match free.pop() {
        Some(place) => places[place as usize] = State::There(it),
        None => places.push(State::There(it)),
    }
}

/// Checks a transform of an instance.
pub(super) fn check(instance: u32, transform: &Transform) -> Result<(), SceneError> {
    for (row, numbers) in transform.iter().enumerate() {
        if let Some(column) = numbers.iter().position(|x| !x.is_finite()) {
            return Err(SceneError::NonFiniteTransform { instance, row, column });
        }
    }
    ObjectSpace::new(transform).map(|_| ()).ok_or(SceneError::SingularTransform { instance })
}

#[cfg(test)]
mod tests;
