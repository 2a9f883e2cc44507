//! What is printed: figures of Martin's survey, a seminar paper at the University of Minnesota, Morris, on
//! Zhou, Hou, Wang and Guo, *Real-Time KD-Tree Construction on Graphics Hardware*, ACM Transactions on
//! Graphics 27(5), 2008, article 126.
//!
//! Times there are of one core (offline) and of the paper's GPU, at 1024 x 1024 pixels.

use serde::Serialize;

/// A row of its Table 3, with the frames a second of its figure of the scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SurveyScene {
    /// The letter of the picture, a to f.
    pub row: char,
    /// Triangles, as printed: in thousands.
    pub kilo_triangles: u32,
    /// Lights.
    pub lights: u32,
    /// T_tree in seconds: offline, GPU.
    pub tree_s: [f64; 2],
    /// SAH cost of the finished tree: offline, GPU. In what units is not said.
    pub sah: [f64; 2],
    /// T_trace in seconds through the tree of: offline, GPU.
    pub trace_s: [f64; 2],
    /// Frames a second with a tree for each, on the GPU.
    pub fps: f64,
    /// The same of other structures, where it is printed: the dynamic BVH of Wald, Boulos and Shirley
    /// 2007.
    pub fps_dbvh: Option<f64>,
    /// The kd-tree of Shevtsov, Soupikov and Kapustin 2007.
    pub fps_shevtsov: Option<f64>,
}

impl SurveyScene {
    /// How many times faster than the offline builder the GPU builds.
    pub fn build_speedup(&self) -> f64 {
        self.tree_s[0] / self.tree_s[1]
    }

    /// SAH cost of the GPU's tree over that of the offline one.
    pub fn sah_ratio(&self) -> f64 {
        self.sah[1] / self.sah[0]
    }

    /// Time to trace through the GPU's tree over that through the offline one.
    pub fn trace_ratio(&self) -> f64 {
        self.trace_s[1] / self.trace_s[0]
    }
}

/// All rows. Row d contradicts itself: its times come to 3.85 frames a second, 4.84 are printed.
pub const SCENES: [SurveyScene; 6] = [
    SurveyScene {
        row: 'a',
        kilo_triangles: 11,
        lights: 1,
        tree_s: [0.085, 0.012],
        sah: [79.0, 67.9],
        trace_s: [0.022, 0.018],
        fps: 32.0,
        fps_dbvh: Some(10.5),
        fps_shevtsov: Some(23.5),
    },
    SurveyScene {
        row: 'b',
        kilo_triangles: 27,
        lights: 2,
        tree_s: [0.108, 0.017],
        sah: [76.6, 38.3],
        trace_s: [0.109, 0.108],
        fps: 8.00,
        fps_dbvh: None,
        fps_shevtsov: None,
    },
    SurveyScene {
        row: 'c',
        kilo_triangles: 71,
        lights: 3,
        tree_s: [0.487, 0.039],
        sah: [68.6, 59.7],
        trace_s: [0.165, 0.157],
        fps: 4.96,
        fps_dbvh: None,
        fps_shevtsov: None,
    },
    SurveyScene {
        row: 'd',
        kilo_triangles: 111,
        lights: 6,
        tree_s: [0.559, 0.053],
        sah: [49.6, 77.8],
        trace_s: [0.226, 0.207],
        fps: 4.84,
        fps_dbvh: None,
        fps_shevtsov: None,
    },
    SurveyScene {
        row: 'e',
        kilo_triangles: 178,
        lights: 2,
        tree_s: [1.226, 0.077],
        sah: [74.4, 94.6],
        trace_s: [0.087, 0.078],
        fps: 6.40,
        fps_dbvh: Some(2.30),
        fps_shevtsov: Some(5.84),
    },
    SurveyScene {
        row: 'f',
        kilo_triangles: 252,
        lights: 1,
        tree_s: [1.354, 0.093],
        sah: [124.2, 193.9],
        trace_s: [0.027, 0.025],
        fps: 8.85,
        fps_dbvh: None,
        fps_shevtsov: None,
    },
];

/// Greatest speed-up with more processors that its Figure 12 shows for its largest scene (the dragon).
/// They compare as ratios only.
pub const SCALING_LARGEST: f64 = 6.0;
/// The same for its smallest (the toys).
pub const SCALING_SMALLEST: f64 = 3.0;

/// The row whose number of triangles is nearest, by ratio.
pub fn nearest(triangles: usize) -> &'static SurveyScene {
    let distance = |scene: &SurveyScene| {
        (triangles.max(1) as f64 / (1e3 * f64::from(scene.kilo_triangles))).ln().abs()
    };
    let mut best = &SCENES[0];
    for scene in &SCENES {
        if distance(scene) < distance(best) {
            best = scene;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_find_their_rows() {
        for (triangles, row) in
            [(0, 'a'), (11_000, 'a'), (69_451, 'c'), (111_000, 'd'), (203_000, 'e'), (1 << 30, 'f')]
        {
            assert_eq!(nearest(triangles).row, row, "{triangles}");
        }
    }

    /// What follows from the printed figures, and where they contradict themselves.
    #[test]
    fn printed_rates_follow_from_printed_times_but_for_one_row() {
        for scene in &SCENES {
            let computed = 1.0 / (scene.tree_s[1] + scene.trace_s[1]);
            let off = (computed / scene.fps - 1.0).abs();
            assert_eq!(off > 0.05, scene.row == 'd', "{} {computed}", scene.row);
        }
        assert!((SCENES[4].build_speedup() - 15.92).abs() < 0.01);
        assert!((SCENES[1].sah_ratio() - 0.5).abs() < 1e-3);
        assert!((SCENES[0].trace_ratio() - 0.818).abs() < 1e-3);
    }
}
