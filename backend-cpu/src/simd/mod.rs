//! Vector instructions: what an instruction set can do, said once, so that builders and queries are written once for
//! all sets.
//!
//! [`Simd`] is an instruction set. A vector has [`Simd::N`] lanes. A node's children, a block's
//! triangles, and the rays of a packet's group are lanes. Sums, differences, products and quotients
//! round each by itself, as scalar code does: only [`Simd::mul_sub`] may round differently from set
//! to set, and no decision on a hit depends on it. So every set gives the same hits.
//!
//! Two more vocabularies belong to a set, since builders need what lanes of changing number cannot say:
//! [`Simd::F32x16`], sixteen floats on any set, and the loops over references of [`references::ReferenceOps`].
//!
//! Each set is in a file of its own: `avx512/`, `avx2.rs` (and `avx2/`), `sse2.rs`, `neon.rs`, `simd128.rs`,
//! `portable.rs`. Intrinsics are used nowhere else, except for [`F32x4`], which is SSE2.

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512;
pub(crate) mod columns;
pub(crate) mod every_set;
pub(crate) mod f32x16;
mod f32x4;
mod instruction_set;
#[cfg(all(target_arch = "aarch64", not(miri)))]
mod neon;
pub(crate) mod portable;
pub(crate) mod references;
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
mod simd128;
#[cfg(target_arch = "x86_64")]
pub(crate) mod sse2;

pub(crate) use f32x4::F32x4;
pub use instruction_set::InstructionSet;

use f32x16::F32x16;
use references::ReferenceOps;

/// Numbers that the builders' operations take at once, on any set.
pub(crate) const WIDTH: usize = 16;

/// The most lanes of any set.
pub(crate) const MOST_LANES: usize = 16;

/// Whether an order is read forwards or backwards.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(crate) struct Direction {
    /// Where a table by masks of eight, forwards and then backwards, begins for it.
    pub table: u32,
    /// Where each place of the order is.
    pub places: [u8; MOST_LANES],
    /// The same from the other end.
    pub reversed: [u8; MOST_LANES],
}

impl Direction {
    /// For orders of `lanes` places.
    pub(crate) const fn new(lanes: usize, backwards: bool) -> Direction {
        let (mut places, mut reversed) = ([0; MOST_LANES], [0; MOST_LANES]);
        let mut i = 0;
        while i < lanes {
            let (first, last) = (i as u8, (lanes - 1 - i) as u8);
            (places[i], reversed[i]) = if backwards { (last, first) } else { (first, last) };
            i += 1;
        }
        Direction { table: if backwards { 256 } else { 0 }, places, reversed }
    }
}

/// An instruction set.
///
/// # Safety
/// All methods: the processor must have the set, and pointers must be good for as many elements as
/// the method says; none needs alignment.
pub(crate) trait Simd: ReferenceOps + Copy {
    /// Lanes.
    const N: usize;
    /// Whether layouts for this set may have [corners written out](crate::layout::corners): sets of eight lanes with
    /// permutations. Others do not compile the kernels for it.
    const WRITES_OUT: bool = false;
    /// Whether watertight rays through scenes and packets of exact rays have kernels of their own. Sets without them
    /// trace such rays by the kernels that serve all.
    const SPECIALISED: bool = false;
    /// Whether there are sixteen lanes: a constant, so that what other sets do is not compiled.
    const WIDE: bool = Self::N == 16;
    /// Sixteen floats, however many lanes a vector has.
    type F32x16: F32x16;
    /// A set of eight lanes that the processor has too.
    type Eight: Simd;
    /// `N` floats.
    type Floats: Copy;
    /// `N` places in a table of `2 N`, from `N` bytes.
    type Places: Copy;
    /// `N` yes or no.
    type Mask: Copy;

    /// The same number in all lanes.
    unsafe fn splat(x: f32) -> Self::Floats;
    /// `N` floats from memory.
    unsafe fn load(from: *const f32) -> Self::Floats;
    /// `N` floats to memory.
    unsafe fn store(to: *mut f32, x: Self::Floats);
    /// Sums.
    unsafe fn add(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// Differences.
    unsafe fn sub(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// Products.
    unsafe fn mul(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// Quotients.
    unsafe fn div(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a * b - c`, rounded once or twice.
    unsafe fn mul_sub(a: Self::Floats, b: Self::Floats, c: Self::Floats) -> Self::Floats;
    /// `a` where it is less than `b`, else `b`: so `b` where either is no number.
    unsafe fn min(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a` where it is greater than `b`, else `b`.
    unsafe fn max(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// Magnitudes.
    unsafe fn abs(a: Self::Floats) -> Self::Floats;
    /// Where `a <= b`; not where either is no number.
    unsafe fn le(a: Self::Floats, b: Self::Floats) -> Self::Mask;
    /// Both.
    unsafe fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// `a` where the mask says so, else 0.
    unsafe fn keep(mask: Self::Mask, a: Self::Floats) -> Self::Floats;
    /// `a` where the mask says so, else `b`.
    unsafe fn select(mask: Self::Mask, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// A bit per lane, the first lane lowest.
    unsafe fn bits(mask: Self::Mask) -> u32;
    /// The mask of these bits.
    unsafe fn mask(bits: u32) -> Self::Mask;
    /// The number in a lane, which must exist.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn lane(of: Self::Floats, lane: usize) -> f32 {
        let mut row = [0.0; MOST_LANES];
        // SAFETY: the caller's contract; no set has more lanes.
        unsafe { Self::store(row.as_mut_ptr(), of) };
        row[lane]
    }
    /// The lanes of `of` (none of which is no number) with the least number of theirs, as bits; others may
    /// be among them.
    unsafe fn least(of: u32, a: Self::Floats) -> u32;
    /// The least of all lanes, none of which is no number.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn lowest(of: Self::Floats) -> f32 {
        let mut row = [f32::INFINITY; MOST_LANES];
        // SAFETY: the caller's contract; no set has more lanes.
        unsafe { Self::store(row.as_mut_ptr(), of) };
        row.iter().fold(row[0], |least, &x| if x < least { x } else { least })
    }
    /// The greatest of all lanes, none of which is no number.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn highest(of: Self::Floats) -> f32 {
        let mut row = [f32::NEG_INFINITY; MOST_LANES];
        // SAFETY: the caller's contract; no set has more lanes.
        unsafe { Self::store(row.as_mut_ptr(), of) };
        row.iter().fold(row[0], |most, &x| if x > most { x } else { most })
    }
    /// Writes the lanes of `bits`, in their order. `N` numbers may be written in all.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn compress(of: Self::Floats, bits: u32, to: *mut f32) {
        let mut row = [0.0; MOST_LANES];
        // SAFETY: the caller's contract; no set has more lanes.
        unsafe {
            Self::store(row.as_mut_ptr(), of);
            let mut end = 0;
            for (lane, &x) in row[..Self::N].iter().enumerate() {
                *to.add(end) = x;
                end += (bits >> lane & 1) as usize;
            }
        }
    }
    /// Divides `N` rows of columns: those of `bits` go to the places from `left` on, in their order, the others to those from `right` on. `N`
    /// rows may be written from either place. There are no more than five columns, and none that is read is written.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn split(bits: u32, from: &[*mut u32], to: &[*mut u32], left: usize, right: usize) {
        // SAFETY: the caller's contract.
        unsafe { split_exactly(Self::N, bits, from, to, left, right) }
    }
    /// Adds keys to the eight least ones, which stand in order: those of lanes of `near`, a number in the upper half (none less than 0), the lower half from
    /// `points`. Keys from the eighth on have no effect.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn keep_least(keys: &mut LeastKeys, numbers: *const f32, points: *const u32, near: u32) {
        let mut left = near;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            // SAFETY: the caller's contract.
            let key = unsafe { key_of(*numbers.add(lane), *points.add(lane)) };
            for place in (1..8).rev() {
                keys.0[place] = keys.0[place].min(keys.0[place - 1].max(key));
            }
            keys.0[0] = keys.0[0].min(key);
        }
    }
    /// Which of `N` numbers in memory are a given one, as bits.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn equal(from: *const u32, number: u32) -> u32 {
        let mut bits = 0;
        for i in 0..Self::N {
            // SAFETY: the caller's contract.
            bits |= u32::from(unsafe { *from.add(i) } == number) << i;
        }
        bits
    }
    /// Keeps, of `count` entries, those with a `t` of at most `stop`, in their order; how many. Reads
    /// no more, but may write `N` entries more.
    unsafe fn cull(children: *mut u32, t: *mut f32, count: usize, stop: f32) -> usize;
    /// Places from `N` bytes, each below 2 `N`, or anything where the result does not matter.
    unsafe fn places(from: *const u8) -> Self::Places;
    /// Elements of a table of `2 N`.
    unsafe fn look_up(table: [Self::Floats; 2], at: Self::Places) -> Self::Floats;
    /// Elements of a table of `N`; places are below `N`, or anything where the result does not matter.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn look_up_low(table: Self::Floats, at: Self::Places) -> Self::Floats {
        // SAFETY: the caller's contract.
        unsafe { Self::look_up([table, table], at) }
    }
    /// Turns `N` rows of `N` floats, `stride` apart, into rows of what stood in columns, `to_stride`
    /// apart.
    unsafe fn transpose(from: *const f32, stride: usize, to: *mut f32, to_stride: usize);
    /// Writes the children of a mask to the end of a stack, in the order that `order` gives their
    /// places in (read in the order of `direction`), with the `t` of each. `N` elements are written
    /// in all, of which as many count as the mask has lanes: `t` must be less than infinity there.
    /// Returns the last one that counts, or anything where none does: reading it back would wait
    /// for the stores.
    unsafe fn push(
        children: *const u32,
        t: Self::Floats,
        mask: Self::Mask,
        order: *const u8,
        direction: &Direction,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> u32;

    /// Writes the lanes of `bits`, each as a pair of its number in a vector and its number in memory, the first lane first. `N` pairs may be
    /// written in all.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push_pairs(first: Self::Floats, second: *const u32, bits: u32, to: *mut [u32; 2]) {
        let mut row = [0.0; MOST_LANES];
        // SAFETY: the caller's contract; no set has more lanes.
        unsafe {
            Self::store(row.as_mut_ptr(), first);
            let (mut left, mut end) = (bits, 0);
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                *to.add(end) = [row.get_unchecked(lane).to_bits(), *second.add(lane)];
                end += 1;
            }
        }
    }

    /// Writes the children of a mask, of eight, to the end of a stack with the `t` of each, the least `t` last. Those that differ by less than 2^-20 of
    /// themselves, or by less than 2^-146, may be exchanged. `N` elements are written in all. Only for sets of eight lanes. Each `t` of the mask must be finite.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push_nearest_last(
        children: *const u32,
        t: Self::Floats,
        mask: Self::Mask,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> usize {
        let mut row = [0.0; MOST_LANES];
        // SAFETY: the caller's contract; no set has more lanes.
        unsafe {
            Self::store(row.as_mut_ptr(), t);
            let (mut left, mut end) = (Self::bits(mask), 0);
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                let (t, mut at) = (*row.get_unchecked(lane), end);
                while at > 0 && *to_t.add(at - 1) <= t {
                    *to_t.add(at) = *to_t.add(at - 1);
                    *to_children.add(at) = *to_children.add(at - 1);
                    at -= 1;
                }
                (*to_t.add(at), *to_children.add(at)) = (t, *children.add(lane));
                end += 1;
            }
            end
        }
    }

    /// Does a task in a function of its own, compiled for the set.
    #[inline(never)]
    unsafe fn call<T: Compiled>(task: T) -> T::Output {
        // SAFETY: the caller's contract.
        unsafe { task.run::<Self>() }
    }

    /// [`Simd::push`] for the children whose exit is at or behind their entry. Returns the last one, as
    /// there, and how many there are.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push_met(
        children: *const u32,
        enter: Self::Floats,
        exit: Self::Floats,
        order: *const u8,
        direction: &Direction,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> (u32, usize) {
        // SAFETY: the caller's contract.
        unsafe {
            let met = Self::le(enter, exit);
            let last = Self::push(children, enter, met, order, direction, to_children, to_t);
            (last, Self::bits(met).count_ones() as usize)
        }
    }

    /// [`Simd::push_met`] for a ray that waits for what comes next, which takes less time here and more work. `to_children` and
    /// `to_t` follow another entry. Returns the last child that counts, or that entry's where none does, and how many count.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push_met_alone(
        children: *const u32,
        enter: Self::Floats,
        exit: Self::Floats,
        order: *const u8,
        direction: &Direction,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> (u32, usize) {
        // SAFETY: the caller's contract.
        unsafe {
            let below = *to_children.sub(1);
            let (nearest, count) =
                Self::push_met(children, enter, exit, order, direction, to_children, to_t);
            (core::hint::select_unpredictable(count == 0, below, nearest), count)
        }
    }

    /// Eight of the eight numbers of two rows, by their places, to memory.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn pick(rows: [F32x4; 2], places: &[u32; 8], to: &mut [f32; 8]) {
        let rows = [rows[0].row(), rows[1].row()];
        for (to, place) in to.iter_mut().zip(places) {
            *to = rows.as_flattened()[*place as usize % 8];
        }
    }

    /// The greater of two magnitudes.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn magnitude(a: Self::Floats, b: Self::Floats) -> Self::Floats {
        // SAFETY: the caller's contract.
        unsafe { Self::max(Self::abs(a), Self::abs(b)) }
    }

    /// Which of 64 bytes are in ranges, as bits: the byte less that of `first` is at most that of `span`. Only where
    /// `there` has a bit.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn bytes_in_ranges(
        bytes: &[[u8; 8]; 8],
        first: &[u8; 64],
        span: &[u8; 64],
        there: u64,
    ) -> u64 {
        let mut bits = 0;
        for bit in 0..64 {
            let inside = bytes[bit / 8][bit % 8].wrapping_sub(first[bit]) <= span[bit];
            bits |= u64::from(inside) << bit;
        }
        bits & there
    }

    /// What rounding took from products: `a * b` without error, less [`Simd::mul`] of them, rounded.
    unsafe fn product_error(a: Self::Floats, b: Self::Floats) -> Self::Floats;
}

/// Eight keys in order.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct LeastKeys(pub [u64; 8]);

/// A key: see [`Simd::keep_least`].
#[cfg_attr(not(unoptimised), inline(always))]
fn key_of(number: f32, point: u32) -> u64 {
    u64::from(number.to_bits()) << 32 | u64::from(point)
}

/// [`Simd::split`] of so many rows, by which no more is written than they are.
///
/// # Safety
/// The columns must have the rows and the places.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn split_exactly(
    lanes: usize,
    bits: u32,
    from: &[*mut u32],
    to: &[*mut u32],
    mut left: usize,
    mut right: usize,
) {
    let mut places = [0; MOST_LANES];
    for (lane, place) in places[..lanes].iter_mut().enumerate() {
        let is_left = bits >> lane & 1 != 0;
        *place = core::hint::select_unpredictable(is_left, left, right);
        left += usize::from(is_left);
        right += usize::from(!is_left);
    }
    for (&from, &to) in from.iter().zip(to) {
        for (lane, &place) in places[..lanes].iter().enumerate() {
            // SAFETY: the caller's contract.
            unsafe { *to.add(place) = *from.add(lane) };
        }
    }
}

/// What is compiled once for each instruction set.
pub(crate) trait Compiled {
    /// What comes of it.
    type Output;

    /// Does the work. This, and everything that it calls with the set, must always be inlined,
    /// unless nothing is optimised (`build.rs`): a separate function is compiled for no set, and
    /// each of its operations would be a call.
    ///
    /// # Safety
    /// The processor must have the set.
    unsafe fn run<S: Simd>(self) -> Self::Output;
}

/// The same address, of which the compiler does not know that it is: what is read from there in a loop is read where it says.
#[cfg_attr(not(unoptimised), inline(always))]
#[allow(clippy::pointers_in_nomem_asm_block, reason = "the address is all that counts")]
pub(crate) fn not_known<T>(at: *const T) -> *const T {
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    {
        let mut same = at;
        // SAFETY: no instruction at all.
        unsafe {
            core::arch::asm!("/* {0} */", inout(reg) same, options(nomem, nostack, preserves_flags));
        }
        same
    }
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    at
}

/// Asks for the cache line at an address that need not be readable.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn prefetch(at: *const u8) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: a prefetch reads nothing and faults nowhere; SSE is part of x86-64.
    unsafe {
        core::arch::x86_64::_mm_prefetch::<{ core::arch::x86_64::_MM_HINT_T0 }>(at.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = at;
}

#[cfg(test)]
mod tests;
