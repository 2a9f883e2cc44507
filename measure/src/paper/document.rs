//! The report as a whole: what was measured, as JSON, CSV and Markdown.

use super::areas::Areas;
use super::claims::{self, Claim};
use super::figures::Figure;
use super::machine::{Knobs, Machine};
use super::motion::Motion;
use super::objects::Objects;
use super::scaling::Scaling;
use super::scene::SceneReport;
use super::table::Table;
use super::tables::{figure_7, figure_12, table_3, table_4};
use super::worked::Worked;
use serde::Serialize;

/// What was measured.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Version of this format: 2.
    pub format: u32,
    /// On what.
    pub machine: Machine,
    /// Pixels of a frame, from left to right and from top to bottom.
    pub size: [u32; 2],
    /// Runs of each measure, of which the median counts.
    pub repeat: usize,
    /// How trees were shaped.
    pub presets: Vec<Knobs>,
    /// Tables 1 and 2, and Equation 4.
    pub worked: Worked,
    /// Table 3.
    pub scenes: Vec<SceneReport>,
    /// Table 4.
    pub motions: Vec<Motion>,
    /// What Figures 5 and 6 show; none where no tree tells two objects apart.
    pub objects: Option<Objects>,
    /// The scene of Figure 7.
    pub areas_scene: String,
    /// Figure 7.
    pub areas: Areas,
    /// Figure 12.
    pub scaling: Vec<Scaling>,
    /// What the survey claims without figures.
    pub claims: Vec<Claim>,
    /// All figures.
    pub figures: Vec<Figure>,
}

impl Report {
    /// The tables by the names of their files, without ending.
    pub fn tables(&self) -> [(&'static str, Table); 8] {
        [
            ("table-1", self.worked.table_1()),
            ("table-2", self.worked.table_2()),
            ("equations", self.worked.table_of_forms()),
            ("table-3", table_3(&self.scenes)),
            ("table-4", table_4(&self.motions)),
            ("figure-7", figure_7(&self.areas)),
            ("figure-12", figure_12(&self.scaling)),
            ("claims", claims::table(&self.claims)),
        ]
    }

    /// The text, with tables and pictures.
    pub fn markdown(&self) -> String {
        let [width, height] = self.size;
        let [table_1, table_2, forms, table_3, table_4, _, figure_12, claims] =
            self.tables().map(|(_, table)| table.markdown());
        let mut out = format!(
            "# What the survey reports, measured with splitplane\n\n\
             Zhou, Hou, Wang and Guo, *Real-Time KD-Tree Construction on Graphics Hardware* (2008), as \
             Martin's survey reports it, measured on the scenes below. Columns that begin with \
             \"survey's\" are its figures, of its scenes and machines of 2008, in the row of nearest \
             size; all others were measured here. Scenes differ, so compare ratios, not times.\n\n\
             {}- frames of {width} x {height} pixels; every time is the median of {} run{}\n\n",
            self.machine.markdown(),
            self.repeat,
            if self.repeat == 1 { "" } else { "s" }
        );
        if self.repeat == 1 {
            out += "**One run is no measurement: the times below only show that the program works.**\n\n";
        }
        out += "The presets that shaped the trees:\n\n";
        out += &presets(&self.presets).markdown();
        out += "\n## Tables 1 and 2, Equation 4: the worked example\n\n\
                The tree of the survey's Figure 8, built node by node in its cube of side 10; half areas (Equation 1 without \
                its factor of two), costs by the number of children k (Equation 2) and their sum (Equations 3 and 4) by \
                `core/src/sah.rs`. Two rows are misprinted.\n\n";
        out += &table_1;
        out += "\nThe misprint of 88 for 68 goes into Table 2 and Equation 4 with k = 0, a leaf's, and so \
                changes neither:\n\n";
        out += &table_2;
        out += "\n## Equations 1, 5 and 6, as printed and as used\n\n\
                The printed form of Equation 5 is a slip: with areas over the parent's it grows with the number of nodes, and a leaf costs \
                the same whatever is in it. Equation 6 is right as printed, with C_ts = K_T/K_I; presets cost leaves by blocks of W \
                triangles, which a wide test takes at once, and compare costs as integers.\n\n";
        out += &forms;
        out += "\n## Table 3: time to build, time to trace, cost\n\n\
                T_tree: from triangles in memory to a tree that rays can be traced through; the offline \
                builder has one thread, as the survey's, the others all of them. T_trace: a frame of \
                camera and shadow rays, one camera ray a pixel, no reflections, shaded, until its pixels are \
                in memory; traced on all threads, or on the GPU, whoever built the tree. Rows with \
                equal knobs are of builders that are all told W = 1, K_T = 3 and K_I = 4 (the ratio of Wald and Havran 2006; the \
                survey does not give its own): they compare as the survey's builders do. Rows with tuned knobs are the \
                presets. SAH cost: Equation 5 relative to the root, each triangle of a leaf counted, in units of K_I, with \
                these K_T and K_I for all rows. As printed: relative to each node's parent, a leaf's \
                triangles not counted. Presets make the block cost small, \
                which counts leaves by blocks of W triangles, here with W, K_T and K_I of preset fast. Ratios are to the \
                offline builder with the same knobs. The T_trace ratio is given where both were traced on the \
                same device.\n\n";
        out += &table_3;
        out += &self.left_out();
        out += "\nIn the survey's row d, times (3.85 frames a second) and frames a second (4.84) \
                contradict each other, and in row f they differ by 4 %. Clipping makes no new triangles, as the \
                survey has it, but further references to the same one.\n";
        out += "\n## Table 4: frames a second of scenes that move\n\n\
                Every frame's triangles are elsewhere. kd-trees are built from scratch for each frame. A bounding \
                volume hierarchy is built for the first frame and refitted for the others, and once more built for each, to see what \
                refitting loses: \"worst over built anew\" is the greatest ratio of its rays' time to that of the hierarchy built for \
                the same frame. Update and times are medians over the frames. \"rays\" are two batches, the camera rays' closest hits and for \
                each of them a ray towards every light on the surface's side, the same for every structure, without shading; \
                T_trace is a frame of them shaded by our tracer. The survey's figures include shading.\n\n";
        out += &table_4;
        out += &self.motion_note();
        out += &self.pictures(0);
        for figure in [3, 4, 5, 6, 7, 8, 9, 10, 11, 12] {
            out += &self.figure(figure);
        }
        out += "\n";
        out += &figure_12;
        out += &self.scaling_note();
        out += "\n## Claims without figures\n\n\
                What the survey says of builds, cells and rays and prints no figures for. \"As claimed\" is what the claim would give if it \
                held exactly; exponents are those of straight lines of least squares through logarithms. Holds: the figure lies within two standard \
                errors of that, or, where it has none, within a tenth; being less than a bound O(...) is as good. Cells and rays are those of the largest scene above.\n\n";
        out += &claims;
        out
    }

    fn left_out(&self) -> String {
        let mut all: Vec<&String> = self.scenes.iter().flat_map(|scene| &scene.left_out).collect();
        all.dedup();
        let mut out: String = all.into_iter().map(|why| format!("\nLeft out: {why}.\n")).collect();
        for scene in &self.scenes {
            for preset in scene.differing() {
                out += &format!(
                    "\n**The GPU's tree of `{}` by preset {preset} is another one than the CPU's.**\n",
                    scene.name
                );
            }
        }
        out
    }

    fn motion_note(&self) -> String {
        let mut out = String::new();
        for motion in &self.motions {
            let rays: usize = motion.rays.iter().sum();
            out += &format!(
                "\n({}) `{}`: {} frames, {}; {rays} rays in all; the refitted hierarchy finds another distance for {} camera \
                 rays (its triangle test may leak at edges).",
                motion.letter,
                motion.scene,
                motion.rays.len(),
                motion.moves,
                motion.different
            );
            if let Some([first, worst]) = motion.decay() {
                out += &format!(
                    " Its rays take {first:.2} times as long as those through one built anew in the first frame, {worst:.2} \
                     times in the worst."
                );
            }
            out += "\n";
        }
        out
    }

    fn scaling_note(&self) -> String {
        let mut out = String::new();
        if self.scaling.iter().any(|scaling| scaling.software) {
            out += "\nThe adapter is software: it runs workgroups on the CPU's threads, so that its curve means nothing for a GPU.\n";
        }
        let failed: Vec<String> = self
            .scaling
            .iter()
            .filter(|scaling| !scaling.failed.is_empty())
            .map(|scaling| {
                format!(
                    "\nLeft out for `{}`: {:?} workgroups. The driver ended long loops there, and the \
                     tree was another one.\n",
                    scaling.scene, scaling.failed
                )
            })
            .collect();
        out + &failed.concat()
    }

    /// The section of a figure.
    fn figure(&self, number: u32) -> String {
        let mut out = format!("\n## Figure {number}\n");
        let pictures = self.pictures(number);
        out += match (pictures.is_empty(), number) {
            (true, 5 | 6) => {
                "\nNo tree of these scenes tells two objects apart that could be drawn.\n"
            }
            (true, _) => "\nNo node of these scenes was cut and then split at its median.\n",
            (false, _) => &pictures,
        };
        out
    }

    /// The pictures of a number, with what they show.
    fn pictures(&self, number: u32) -> String {
        let own = self.figures.iter().filter(|figure| figure.number == number);
        let picture = |figure: &Figure| {
            let file = figure.files.first().map_or("", String::as_str);
            let words = if number == 0 { "Table 4".into() } else { format!("Figure {number}") };
            format!("\n![{words}]({file})\n\n{}\n", figure.caption)
        };
        own.map(picture).collect()
    }
}

fn presets(knobs: &[Knobs]) -> Table {
    let mut table = Table::new(&[
        "preset",
        "K_T",
        "K_I",
        "W",
        "T",
        "C_e / 256",
        "depth",
        "bins",
        "clip",
        "empty bonus / 256",
        "bad splits",
    ]);
    for knobs in knobs {
        table.push(vec![
            knobs.preset.into(),
            knobs.traversal_cost.into(),
            knobs.intersection_cost.into(),
            knobs.block_width.into(),
            knobs.small_node_limit.map_or_else(|| "".into(), Into::into),
            knobs.empty_cutoff.map_or_else(|| "".into(), Into::into),
            knobs.max_depth.into(),
            knobs.bins.map_or_else(|| "".into(), Into::into),
            if knobs.clip { "yes" } else { "no" }.into(),
            knobs.empty_bonus.map_or_else(|| "".into(), Into::into),
            knobs.bad_splits.map_or_else(|| "".into(), Into::into),
        ]);
    }
    table
}
