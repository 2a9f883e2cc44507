//! What several tests use.

use splitplane_core::ray::Hit;
use splitplane_test_support::scenes::{self, Scene};

/// Whether there is time for many rays and builds.
pub(crate) fn long() -> bool {
    std::env::var_os("SPLITPLANE_LONG").is_some_and(|value| value == "1")
}

/// The awkward scenes, and real ones where they are present.
pub(crate) fn all_scenes() -> Vec<Scene> {
    let mut all = scenes::awkward();
    all.extend(["horse", "bunny", "kitchen"].iter().filter_map(|name| scenes::real(name)));
    all
}

/// A box of twelve triangles, outside in front.
pub(crate) fn cube(lo: [f32; 3], hi: [f32; 3]) -> Scene {
    let positions = (0..8u32)
        .map(|i| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { lo[axis] } else { hi[axis] }))
        .collect();
    let indices = Some(vec![
        [0, 2, 1],
        [1, 2, 3],
        [4, 5, 6],
        [5, 7, 6],
        [0, 1, 4],
        [1, 5, 4],
        [2, 6, 3],
        [3, 6, 7],
        [0, 4, 2],
        [2, 4, 6],
        [1, 3, 5],
        [3, 7, 5],
    ]);
    Scene { name: "cube".into(), positions, indices }
}

/// A tetrahedron with whole corners, outside in front.
pub(crate) fn tetrahedron() -> Scene {
    let positions = vec![[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]];
    let indices = Some(vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]);
    Scene { name: "tetrahedron".into(), positions, indices }
}

/// Bits, so that -0 differs from 0 and NaN equals itself.
pub(crate) fn bits(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()]
}
