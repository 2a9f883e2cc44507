//! A ray as the tree over instances tests it, where rays take their steps in turn.

/// A ray as the tree over instances tests it: see [`VectorRay`](super::top_walk::VectorRay), for boxes that are all widened alike. A cache line.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct TurnRay {
    pub(super) reciprocal: [f32; 3],
    pub(super) enter: f32,
    pub(super) first: [f32; 3],
    pub(super) stop: f32,
    pub(super) last: [f32; 3],
    /// Bits 0 to 2: the direction is negative on x, y, z.
    pub(super) octant: u32,
    unused: [u32; 4],
}

impl TurnRay {
    /// Its words.
    pub(super) const WORDS: usize = size_of::<TurnRay>() / 4;

    /// No ray.
    pub(super) const NONE: TurnRay = TurnRay {
        reciprocal: [0.0; 3],
        enter: 0.0,
        first: [0.0; 3],
        stop: 0.0,
        last: [0.0; 3],
        octant: 0,
        unused: [0; 4],
    };
}
