//! How coarse a picture is while things move: coarse enough to follow the hand.

/// How long a frame may take while something moves, in milliseconds.
pub(super) const BUDGET_MS: f64 = 50.0;
/// Coarsest picture: one ray for so many pixels on a side.
const COARSEST: u32 = 8;
/// A finer picture must promise to take this part of the budget at most; otherwise pictures on the
/// edge of the budget would flicker between two sizes.
const MARGIN: f64 = 0.7;

/// The size of a picture pixel on the screen while things move: 1, 2, 4 or 8 pixels on a side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Resolution {
    step: u32,
}

impl Resolution {
    /// Coarse until the first frame has shown what a frame takes.
    pub(super) fn new() -> Resolution {
        Resolution { step: COARSEST / 2 }
    }

    pub(super) fn step(self) -> u32 {
        self.step
    }

    /// Learns from a frame: it took so long with this step. Work is taken to grow with the number of
    /// rays.
    pub(super) fn learn(&mut self, took_ms: f64, step: u32) {
        if !took_ms.is_finite() {
            return;
        }
        let full = took_ms * f64::from(step * step);
        let mut next = 1;
        while next < COARSEST {
            let expected = full / f64::from(next * next);
            let allowed = if next < self.step { BUDGET_MS * MARGIN } else { BUDGET_MS };
            if expected <= allowed {
                break;
            }
            next *= 2;
        }
        self.step = next;
    }
}

/// A side of the picture at some step: at least one pixel.
pub(super) fn reduced(side: u32, step: u32) -> u32 {
    side.div_ceil(step).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_frames_get_coarser_and_fast_ones_finer() {
        let mut resolution = Resolution::new();
        resolution.learn(10.0, 1);
        assert_eq!(resolution.step(), 1);
        resolution.learn(100.0, 1);
        assert_eq!(resolution.step(), 2);
        resolution.learn(100.0, 2);
        assert_eq!(resolution.step(), 4);
        resolution.learn(1e9, 8);
        assert_eq!(resolution.step(), COARSEST);
        resolution.learn(0.1, 8);
        assert_eq!(resolution.step(), 1);
    }

    #[test]
    fn a_frame_on_the_edge_of_the_budget_does_not_flicker() {
        let mut resolution = Resolution { step: 2 };
        // At full size it would take 0.9 of the budget: allowed, but not worth going back to.
        resolution.learn(0.9 * BUDGET_MS / 4.0, 2);
        assert_eq!(resolution.step(), 2);
        let mut resolution = Resolution { step: 1 };
        resolution.learn(0.9 * BUDGET_MS, 1);
        assert_eq!(resolution.step(), 1);
    }

    #[test]
    fn no_side_vanishes() {
        assert_eq!(reduced(1, 8), 1);
        assert_eq!(reduced(17, 8), 3);
        assert_eq!(reduced(0, 1), 1);
    }
}
