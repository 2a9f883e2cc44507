//! Chunks that write to the places in a list that a scan has assigned to them.

use splitplane_float_state::standard;

/// Calls `work` for every chunk with the parts of `a` and `b` that are its own, in parallel: those
/// from `start(chunk)` up to `start(chunk + 1)`. Starts must not decrease.
pub(crate) fn by_chunk<A: Send, B: Send>(
    chunks: core::ops::Range<usize>,
    start: &(impl Fn(usize) -> usize + Sync),
    a: &mut [A],
    b: &mut [B],
    work: &(impl Fn(usize, &mut [A], &mut [B]) + Sync),
) {
    match chunks.len() {
        0 => {}
        1 => standard(|| work(chunks.start, a, b)),
        count => {
            let middle = chunks.start + count / 2;
            let at = start(middle) - start(chunks.start);
            let (a_before, a_after) = a.split_at_mut(at.min(a.len()));
            let (b_before, b_after) = b.split_at_mut(at.min(b.len()));
            rayon::join(
                || by_chunk(chunks.start..middle, start, a_before, b_before, work),
                || by_chunk(middle..chunks.end, start, a_after, b_after, work),
            );
        }
    }
}
