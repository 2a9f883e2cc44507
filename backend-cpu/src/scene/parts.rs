//! The geometries of a scene, where all of them are this backend's and of one kind.

use core::mem::size_of;

use splitplane_core::backend::QueryLayout;
use splitplane_core::backend::scene::{BuiltGeometry, BuiltScene};
use splitplane_core::error::{QueryError, refused};
use splitplane_core::ray::Accuracy;
use splitplane_core::scene::{GeometryId, SceneOptions};

use crate::accelerator::CpuAccelerator;
use crate::simd::InstructionSet;

/// The accelerators of a scene's geometries, by name.
pub(super) struct Geometries<'a> {
    accelerators: Vec<Option<&'a CpuAccelerator>>,
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

/// Whether rays can be followed from instance to instance, which filters, opacity masks and exact answers do not allow.
pub(super) fn is_direct(scene: &BuiltScene, options: &SceneOptions<'_>) -> bool {
    options.filter.is_none() && !scene.has_opacity() && options.accuracy != Accuracy::Exact
}

impl<'a> Geometries<'a> {
    /// `None` where geometries are of several kinds, or of another backend.
    ///
    /// # Errors
    /// No memory for the list.
    pub(super) fn of(
        scene: &'a BuiltScene,
        set: InstructionSet,
    ) -> Result<Option<Geometries<'a>>, QueryError> {
        let names = scene.geometries().last().map_or(0, |(name, _)| name.0 as usize + 1);
        let mut accelerators = Vec::new();
        let bytes = names * size_of::<Option<&CpuAccelerator>>();
        accelerators.try_reserve_exact(names).map_err(|_| refused(bytes as u64))?;
        let (mut stack, mut layout) = (0, None);
        for name in 0..names as u32 {
            let Some(geometry) = scene.geometry(GeometryId(name)) else {
                accelerators.push(None);
                continue;
            };
            let Some(own) = accelerator(geometry, set) else { return Ok(None) };
            if layout.is_some_and(|layout| layout != own.layout()) {
                return Ok(None);
            }
            layout = Some(own.layout());
            stack = stack.max(own.parts().0.wide.stack());
            accelerators.push(Some(own));
        }
        Ok(layout.map(|layout| Geometries { accelerators, stack, layout }))
    }

    /// A geometry's accelerator.
    #[inline]
    pub(super) fn get(&self, geometry: GeometryId) -> Option<&'a CpuAccelerator> {
        *self.accelerators.get(geometry.0 as usize)?
    }
}
