//! Rays as C has them.

use bytemuck::Pod;
use library::{Ray, Rays as LibraryRays};
use rayon::prelude::*;

use crate::buffer::{Given, Places, read};
use crate::status::Failure;

/// Rays in your arrays: the points `origin + t * direction` with `t_min <= t <= t_max`. `t` is in units of the direction's length.
///
/// A ray with an origin or direction that is not finite, a direction of zeros or a limit that is NaN hits nothing. Records of eight floats (origin, least t, direction, greatest t)
/// with all four strides 32 are read where they lie. So are rows of six (origin, direction) with both strides 24 and limits that all rays have, by closest and any hits of a tree.
/// Others are copied, some at a time.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Rays {
    /// x, y and z of the first origin.
    pub origins: *const f32,
    /// Bytes from one to the next.
    pub origin_stride: usize,
    /// x, y and z of the first direction, of any length but zero.
    pub directions: *const f32,
    /// Bytes from one to the next.
    pub direction_stride: usize,
    /// Least t; NULL for 0.
    pub t_min: *const f32,
    /// Bytes from one to the next; 0: all rays have the first one.
    pub t_min_stride: usize,
    /// Greatest t; NULL for infinity.
    pub t_max: *const f32,
    /// Bytes from one to the next; 0: all rays have the first one.
    pub t_max_stride: usize,
    /// How many rays.
    pub count: usize,
}

/// Rays that are turned into records at once: few enough for caches, many enough for the batch.
pub(crate) const CHUNK: usize = 1 << 18;
/// Rays that a task turns into records.
const TASK: usize = 1 << 13;

#[derive(Clone, Copy)]
enum Limit<'a> {
    Each(Given<'a, f32>),
    All(f32),
}

impl<'a> Limit<'a> {
    /// # Safety
    /// As for [`Given::new`].
    unsafe fn new(
        first: *const f32,
        stride: usize,
        count: usize,
        (standard, what): (f32, &str),
    ) -> Result<Limit<'a>, Failure> {
        match (first.is_null() || count == 0, stride) {
            (true, _) => Ok(Limit::All(standard)),
            // SAFETY: as the caller says.
            (false, 0) => Ok(Limit::All(unsafe { read(first, what)? })),
            // SAFETY: as the caller says.
            (false, _) => Ok(Limit::Each(unsafe { Given::new(first, stride, count, what)? })),
        }
    }

    #[inline]
    fn at(&self, place: usize) -> f32 {
        match self {
            Limit::Each(each) => each.at(place),
            Limit::All(all) => *all,
        }
    }

    fn places(&self) -> Option<&Places> {
        match self {
            Limit::Each(each) => Some(&each.places),
            Limit::All(_) => None,
        }
    }

    /// Whether the limits are a part of records that begin at an address.
    fn is_at(&self, address: usize) -> bool {
        matches!(self, Limit::Each(each) if each.stride() == RECORD && each.first().addr() == address)
    }
}

const RECORD: usize = size_of::<Ray>();

/// The rays of a call.
pub(crate) struct View<'a> {
    origins: Given<'a, [f32; 3]>,
    directions: Given<'a, [f32; 3]>,
    t_min: Limit<'a>,
    t_max: Limit<'a>,
}

impl<'a> View<'a> {
    /// # Safety
    /// What the record says is memory that nobody writes while the result lives.
    pub(crate) unsafe fn new(rays: *const Rays) -> Result<View<'a>, Failure> {
        // SAFETY: as the caller says.
        let own = unsafe { read(rays, "rays")? };
        let (count, least, most) = (own.count, (0.0, "t_min"), (f32::INFINITY, "t_max"));
        // SAFETY: as the caller says.
        unsafe {
            Ok(View {
                origins: given(own.origins, own.origin_stride, count, "origins")?,
                directions: given(own.directions, own.direction_stride, count, "directions")?,
                t_min: Limit::new(own.t_min, own.t_min_stride, count, least)?,
                t_max: Limit::new(own.t_max, own.t_max_stride, count, most)?,
            })
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.origins.len()
    }

    /// The arrays that are read.
    pub(crate) fn places(&self) -> impl Iterator<Item = &Places> {
        let limits = [self.t_min.places(), self.t_max.places()];
        [&self.origins.places, &self.directions.places]
            .into_iter()
            .chain(limits.into_iter().flatten())
    }

    #[inline]
    pub(crate) fn at(&self, place: usize) -> Ray {
        Ray {
            origin: self.origins.at(place),
            t_min: self.t_min.at(place),
            direction: self.directions.at(place),
            t_max: self.t_max.at(place),
        }
    }

    /// The library's own records, if that is what the caller has.
    fn whole(&self) -> Option<&'a [Ray]> {
        let (first, count) = (self.origins.first().addr(), self.len());
        let at = |given: &Given<'_, [f32; 3]>, place: usize| {
            given.stride() == RECORD && given.first().addr() == first + place
        };
        let record = count > 0
            && at(&self.origins, 0)
            && self.t_min.is_at(first + 12)
            && at(&self.directions, 16)
            && self.t_max.is_at(first + 28);
        // SAFETY: all four parts of each record are there, side by side, and nobody writes them; the alignment is that of floats.
        record.then(|| unsafe { std::slice::from_raw_parts(self.origins.first().cast(), count) })
    }

    /// Rows of six floats with limits that all rays have, if that is what the caller has.
    pub(crate) fn rows(&self) -> Option<LibraryRays<'a>> {
        let (Limit::All(t_min), Limit::All(t_max)) = (self.t_min, self.t_max) else { return None };
        let (first, count) = (self.origins.first(), self.len());
        let strides = [self.origins.stride(), self.directions.stride()];
        let row = count > 0
            && strides == [size_of::<[f32; 6]>(); 2]
            && self.directions.first().addr() == first.addr() + size_of::<[f32; 3]>();
        // SAFETY: both halves of each row are there, side by side, and nobody writes them; the alignment is that of floats.
        let rows = row.then(|| unsafe { std::slice::from_raw_parts(first.cast(), count) });
        rows.map(|rows| LibraryRays::Rows { rows, t_min, t_max })
    }

    /// Shows all rays at once.
    pub(crate) fn all<T>(
        &self,
        show: impl FnOnce(&[Ray]) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        if let Some(whole) = self.whole() {
            return show(whole);
        }
        let mut records = crate::buffer::filled(self.len(), Ray::new([0.0; 3], [0.0; 3]))?;
        self.gather(&mut records, 0);
        show(&records)
    }

    /// Shows the rays, some at a time unless they are the library's own records, each part with the place of its first.
    pub(crate) fn in_parts(
        &self,
        mut show: impl FnMut(&[Ray], usize) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        if let Some(whole) = self.whole() {
            return show(whole, 0);
        }
        let total = self.len();
        if total == 0 {
            return show(&[], 0);
        }
        let blank = Ray::new([0.0; 3], [0.0; 3]);
        let mut records = crate::buffer::filled(total.min(CHUNK), blank)?;
        for first in (0..total).step_by(CHUNK) {
            let records = &mut records[..CHUNK.min(total - first)];
            self.gather(records, first);
            show(records, first)?;
        }
        Ok(())
    }

    /// The same, some at a time whatever they are.
    pub(crate) fn in_small_parts(
        &self,
        mut show: impl FnMut(&[Ray], usize) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        self.in_parts(|rays, first| {
            rays.chunks(CHUNK)
                .enumerate()
                .try_for_each(|(number, part)| show(part, first + number * CHUNK))
        })
    }

    fn gather(&self, records: &mut [Ray], first: usize) {
        let fill = |number: usize, records: &mut [Ray]| {
            for (place, record) in records.iter_mut().enumerate() {
                *record = self.at(first + number * TASK + place);
            }
        };
        if records.len() <= TASK {
            fill(0, records);
        } else {
            records.par_chunks_mut(TASK).enumerate().for_each(|(number, part)| fill(number, part));
        }
    }
}

/// # Safety
/// As for [`Given::new`].
unsafe fn given<'a, T: Pod>(
    first: *const f32,
    stride: usize,
    count: usize,
    what: &str,
) -> Result<Given<'a, T>, Failure> {
    // SAFETY: as the caller says.
    unsafe { Given::new(first.cast(), stride, count, what) }
}
