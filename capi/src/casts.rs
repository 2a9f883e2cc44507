//! Balls and capsules that move along rays until they touch a mesh.

use library::{Cast, Impact as Touched, Ray};

use crate::batch::Report;
use crate::buffer::{Given, Wanted, check, check_offer, filled, offer, read};
use crate::entry::entry;
use crate::handle::{Tree, get};
use crate::options::QueryOptions;
use crate::pool;
use crate::progress::watch;
use crate::query_settings::{Query, Uses};
use crate::ray::{Rays, View};
use crate::status::{Failure, Status};
use crate::tree::look;

/// What moves along rays: balls, or capsules, which are all points within a radius of a segment.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Bodies {
    /// The first radius, 0 or more.
    pub radii: *const f32,
    /// Bytes from one to the next; 0: all have the first one.
    pub radius_stride: usize,
    /// Of capsules, x, y and z from the end of the first segment that moves along the ray to the other end; NULL for balls.
    pub axes: *const f32,
    /// Bytes from one to the next; 0: all have the first one.
    pub axis_stride: usize,
}

/// What a body touches first.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    /// When, in units of the ray's direction: its least t where they touch from the start. Infinity where nothing is touched.
    pub t: f32,
    /// The triangle's place in your arrays; `SPLITPLANE_NONE` where nothing is touched.
    pub triangle: u32,
}

/// One for each, or one for all.
#[derive(Clone, Copy)]
enum Of<'a, T> {
    Each(Given<'a, T>),
    All(T),
}

impl<'a, T: bytemuck::Pod> Of<'a, T> {
    /// # Safety
    /// As for [`Given::new`].
    unsafe fn new(
        first: *const T,
        stride: usize,
        count: usize,
        what: &str,
    ) -> Result<Of<'a, T>, Failure> {
        // SAFETY: as the caller says.
        unsafe {
            match stride {
                0 if count > 0 => Ok(Of::All(read(first, what)?)),
                _ => Ok(Of::Each(Given::new(first, stride, count, what)?)),
            }
        }
    }

    fn at(&self, place: usize) -> T {
        match self {
            Of::Each(each) => each.at(place),
            Of::All(all) => *all,
        }
    }

    fn apart_from<U: Copy>(&self, wanted: &Wanted<'_, U>) -> Result<(), Failure> {
        match self {
            Of::Each(each) => wanted.apart_from(&each.places),
            Of::All(_) => Ok(()),
        }
    }
}

/// What every body that moves along its ray touches first: of equal t the least triangle. `impacts` has room for one record a ray, `impact_stride` bytes apart: 8 where nothing is between them.
/// `options` and `report` may be NULL.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// `rays`, `bodies` and `options` say what is there, `impacts` has the room, and nobody else uses them during the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_impacts(
    tree: Tree,
    rays: *const Rays,
    bodies: *const Bodies,
    options: *const QueryOptions,
    impacts: *mut Impact,
    impact_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(tree)?;
        check_offer(report, "report")?;
        check(bodies, "bodies")?;
        // SAFETY: as the caller says.
        let (query, rays, own) = unsafe {
            (Query::read(options, Uses::IMPACTS)?, View::new(rays)?, read(bodies, "bodies")?)
        };
        let count = rays.len();
        // SAFETY: as the caller says.
        let (radii, axes, mut wanted) = unsafe {
            let radii = Of::new(own.radii, own.radius_stride, count, "radii")?;
            let axes = match own.axes.is_null() {
                true => Of::All([0.0; 3]),
                false => Of::<[f32; 3]>::new(own.axes.cast(), own.axis_stride, count, "axes")?,
            };
            (radii, axes, Wanted::new(impacts, impact_stride, count, "impacts")?)
        };
        rays.places().try_for_each(|given| wanted.apart_from(given))?;
        radii.apart_from(&wanted)?;
        axes.apart_from(&wanted)?;
        let state = look(&object)?;
        let accelerator = &state.accelerator;
        let found = pool::run(query.threads, || {
            let mut sum = Report::default();
            let (mut casts, mut touched) = (Vec::new(), Vec::new());
            rays.in_small_parts(|rays: &[Ray], first| {
                if casts.len() < rays.len() {
                    casts = filled(rays.len(), Cast::ball(Ray::new([0.0; 3], [0.0; 3]), 0.0))?;
                    touched = filled(rays.len(), Touched::NONE)?;
                }
                let (casts, touched) = (&mut casts[..rays.len()], &mut touched[..rays.len()]);
                for (place, (cast, ray)) in (first..).zip(casts.iter_mut().zip(rays)) {
                    *cast = Cast { ray: *ray, axis: axes.at(place), radius: radii.at(place) };
                }
                let part = query.caller.map(|caller| caller.part(first, count));
                sum.add(&accelerator.impacts(casts, touched, &query.impacts(watch(&part)))?);
                for (place, own) in (first..).zip(touched) {
                    wanted.set(place, Impact { t: own.t, triangle: own.triangle });
                }
                Ok(())
            })?;
            Ok(sum)
        })?;
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}
