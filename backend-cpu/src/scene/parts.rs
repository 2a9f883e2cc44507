//! The geometries of a scene, where all meshes of them are this backend's and of one kind.

use core::mem::size_of;

use splitplane_core::backend::QueryLayout;
use splitplane_core::backend::scene::{BuiltGeometry, BuiltScene};
use splitplane_core::error::{QueryError, refused};
use splitplane_core::scene::{GeometryId, SceneOptions, ShapeTree};

use crate::accelerator::CpuAccelerator;
use crate::layout::tree_layout::TreeLayout;
use crate::simd::InstructionSet;
use crate::trace::prepare::ScaleRecord;

/// What all meshes of a scene have in common.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kind {
    /// Entries of the longest stack that a ray needs in one of them.
    stack: usize,
    layout: QueryLayout,
    /// One more than the greatest name.
    names: usize,
}

/// What a geometry's rays meet.
#[derive(Clone, Copy)]
pub(super) enum Reached<'a> {
    /// Triangles, of this backend's and made for the set.
    Triangles(&'a CpuAccelerator),
    /// Shapes.
    Shapes(&'a ShapeTree),
}

/// A geometry of the list.
#[derive(Clone, Copy)]
pub(super) struct Listed<'a> {
    /// What preparing rays for its mesh needs.
    pub(super) scale: ScaleRecord,
    /// Its mesh's layout, where that is not empty.
    pub(super) layout: Option<&'a TreeLayout>,
    /// What rays meet; `None` where there is no geometry of the name.
    pub(super) reached: Option<Reached<'a>>,
}

/// What rays meet in a scene's geometries, by name.
pub(super) struct Geometries<'a> {
    scene: &'a BuiltScene,
    pub(super) set: InstructionSet,
    /// All of them; `None` where they are looked up one by one.
    listed: Option<Vec<Listed<'a>>>,
    /// Entries of the longest stack that a ray needs in one of them.
    pub(super) stack: usize,
    pub(super) layout: QueryLayout,
}

/// A geometry's accelerator, where it is this backend's and was made for the set.
pub(super) fn accelerator(
    geometry: &BuiltGeometry,
    set: InstructionSet,
) -> Option<&CpuAccelerator> {
    let accelerator: &CpuAccelerator = geometry.accelerator().as_any()?.downcast_ref()?;
    (accelerator.instruction_set() == set).then_some(accelerator)
}

/// What a geometry's rays meet; `None` where that is another backend's.
pub(super) fn reached(geometry: &BuiltGeometry, set: InstructionSet) -> Option<Reached<'_>> {
    match geometry.shapes() {
        Some(shapes) => Some(Reached::Shapes(shapes)),
        None => accelerator(geometry, set).map(Reached::Triangles),
    }
}

/// Whether all hits of a query count.
pub(super) fn all_count(scene: &BuiltScene, options: &SceneOptions<'_>) -> bool {
    options.filter.is_none() && !scene.has_opacity()
}

impl Kind {
    /// `None` where meshes are of several kinds, or of another backend, and where there is no geometry.
    pub(super) fn of(scene: &BuiltScene, set: InstructionSet) -> Option<Kind> {
        let mut kind: Option<Kind> = None;
        let mut names = None;
        for (name, geometry) in scene.geometries() {
            names = Some(name.0 as usize + 1);
            let Reached::Triangles(own) = reached(geometry, set)? else { continue };
            let (stack, layout) = (own.parts().0.wide.stack(), own.layout());
            if kind.is_some_and(|kind| kind.layout != layout) {
                return None;
            }
            let stack = kind.map_or(stack, |kind| kind.stack.max(stack));
            kind = Some(Kind { stack, layout, names: 0 });
        }
        // Without meshes nothing needs a stack.
        let kind = kind.unwrap_or(Kind { stack: 0, layout: QueryLayout::Fast, names: 0 });
        Some(Kind { names: names?, ..kind })
    }
}

impl<'a> Geometries<'a> {
    /// The geometries for a batch of so many rays. All are of this kind.
    ///
    /// # Errors
    /// No memory for the list.
    pub(super) fn of(
        scene: &'a BuiltScene,
        set: InstructionSet,
        Kind { stack, layout, names }: Kind,
        rays: usize,
    ) -> Result<Geometries<'a>, QueryError> {
        // A list that is longer than the batch would cost more than it saves.
        if names > rays {
            return Ok(Geometries { scene, set, listed: None, stack, layout });
        }
        let mut listed = Vec::new();
        let bytes = names * size_of::<Listed<'_>>();
        listed.try_reserve_exact(names).map_err(|_| refused(bytes as u64))?;
        listed.extend((0..names as u32).map(|name| {
            let geometry = scene.geometry(GeometryId(name));
            let reached = geometry.and_then(|geometry| reached(geometry, set));
            let none = Listed { scale: ScaleRecord::NONE, layout: None, reached };
            match reached {
                Some(Reached::Triangles(own)) => {
                    let (layout, scale) = own.parts();
                    let layout = (!layout.wide.lines().is_empty()).then_some(layout);
                    Listed { scale: ScaleRecord::new(scale), layout, reached }
                }
                _ => none,
            }
        }));
        Ok(Geometries { scene, set, listed: Some(listed), stack, layout })
    }

    /// What a geometry's rays meet.
    #[inline]
    pub(super) fn get(&self, geometry: GeometryId) -> Option<Reached<'a>> {
        match &self.listed {
            Some(listed) => listed.get(geometry.0 as usize)?.reached,
            None => reached(self.scene.geometry(geometry)?, self.set),
        }
    }

    /// All of them, by name; `None` where they are looked up one by one.
    pub(super) fn listed(&self) -> Option<&[Listed<'a>]> {
        self.listed.as_deref()
    }
}
