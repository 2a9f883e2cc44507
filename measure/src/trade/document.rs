//! What was measured and what follows from it, as JSON, CSV and Markdown.

use super::bvh::{self, Verdict};
use super::held::Held;
use super::interval::{LEAST_APART, confidence};
use super::measure::Measured;
use super::pareto;
use super::payback::Payback;
use super::picture::PictureTrade;
use super::recommend::{self, Recommendation, Step, Wish};
use super::row::{ALL_THREADS, ONE_THREAD, Row};
use crate::paper::machine::Machine;
use serde::{Deserialize, Serialize};

/// The one version of the file's format.
pub const FORMAT: u32 = 4;

/// The scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Subject {
    /// As it was asked for.
    pub spec: String,
    /// Its name.
    pub name: String,
    /// Triangles.
    pub triangles: usize,
    /// A name of its corners.
    pub mesh: String,
}

/// How much was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Amounts {
    /// Rounds of which medians and minima are given.
    pub repeat: usize,
    /// The probability that a median lies in its interval.
    pub confidence: f64,
    /// Most rays of a timed set on the CPU.
    pub sample_rays: usize,
    /// The same on a GPU.
    pub gpu_sample_rays: usize,
    /// Rays of each kind that were judged on the CPU.
    pub error_rays: u64,
    /// The same on a GPU.
    pub gpu_error_rays: u64,
    /// The name of the timed rays.
    pub rays: String,
}

/// A report on a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Trade {
    /// [`FORMAT`].
    pub format: u32,
    /// On what it was measured.
    pub machine: Machine,
    /// The scene.
    pub scene: Subject,
    /// How much was measured.
    pub amounts: Amounts,
    /// What the independent reference says of the exact answers.
    pub held: Held,
    /// A row each setting.
    pub rows: Vec<Row>,
    /// Which row to take for how many rays a build, by the wish's accuracy and errors.
    pub steps: Vec<Step>,
    /// What to take for the wish.
    pub recommendation: Recommendation,
    /// Whether a bounding volume hierarchy would serve better; none where none was measured.
    pub bvh: Option<Verdict>,
    /// What a picture loses by cheaper settings of its own; none where none was asked for.
    pub picture: Option<PictureTrade>,
    /// Settings that were not measured, a sentence each.
    pub left_out: Vec<String>,
}

impl Trade {
    /// Draws the conclusions from what was measured.
    pub fn of(
        spec: String,
        (name, triangles): (String, usize),
        machine: Machine,
        measured: Measured,
        wish: &Wish,
        left_out: Vec<String>,
    ) -> Trade {
        let Measured { budget, mut rows, held, rays, mesh, picture, hierarchy, .. } = measured;
        conclude(&mut rows);
        let amounts = Amounts {
            repeat: budget.repeat,
            confidence: confidence(budget.repeat),
            sample_rays: budget.cpu.sample_rays,
            gpu_sample_rays: budget.gpu.sample_rays,
            error_rays: budget.cpu.error_rays,
            gpu_error_rays: budget.gpu.error_rays,
            rays,
        };
        let recommendation = recommend::recommend(&rows, wish);
        let bvh =
            hierarchy.and_then(|hierarchy| bvh::judge(hierarchy, &rows, recommendation.row, wish));
        Trade {
            format: FORMAT,
            machine,
            scene: Subject { spec, name, triangles, mesh },
            amounts,
            held,
            steps: recommend::steps(&rows, wish),
            recommendation,
            bvh,
            picture,
            rows,
            left_out,
        }
    }

    /// The text, with tables and plots.
    pub fn markdown(&self, plots: &[(&str, &str)]) -> String {
        let mut out = format!(
            "# Settings for `{}`: what they cost and what they get wrong\n\n{} triangles.\n\n{}",
            self.scene.name,
            self.scene.triangles,
            self.machine.markdown()
        );
        out += &format!(
            "- times: medians of {} rounds, in each of which every setting takes its turn; up to {} rays \
             of each kind; in parentheses where the median lies with a probability of {:.0} %; times are told \
             apart where these are {:.0} % apart\n- errors: {} random, edge-aimed and vertex-aimed rays each and up to as many \
             of the timed primary, bounce and shadow rays, against the exact answers\n- exact answers: {}\n",
            self.amounts.repeat,
            self.amounts.sample_rays,
            100.0 * self.amounts.confidence,
            100.0 * LEAST_APART,
            self.amounts.error_rays,
            self.held.words()
        );
        if self.amounts.repeat < 3 {
            out += "\n**So few rounds are no measurement: the times only show that the program works.**\n";
        }
        for sentence in &self.left_out {
            out += &format!("\nLeft out: {sentence}.\n");
        }
        out += &format!("\n## Recommendation\n\n{}\n\n", self.recommendation.words);
        out += &self.steps_table().markdown();
        if let Some(bvh) = &self.bvh {
            out += &format!("\n{}\n", bvh.words);
        }
        for (file, caption) in plots {
            out += &format!("\n## {caption}\n\n![{caption}]({file})\n");
        }
        out += "\n## All settings\n\n\
                Settings of a preset whose trees have the same nodes and references are one row. A row beats another of its field when it is \
                worse in none of build time, ns a ray, memory, errors and rounded answers, and better in one beyond the noise. *opt* \
                marks rows that are better than each other row in something beyond the noise, so that none can beat them; *opt?* those that \
                none beats, though what saves them may be noise. ns a ray: the mean over primary, shadow, bounce and random rays. SAH \
                costs are at the K_T, K_I and W of preset fast for all rows. Errors: missing, wrong and \
                phantom hits a million rays, over all kinds of rays, and over those that are *not aimed* at edges and vertices; rounded are \
                answers that differ from the exact ones within rounding, which are no errors. *pays* is after how many rays a build it \
                costs less than preset fast at the same accuracy, backend and threads, by the medians and by the intervals.\n\n";
        out += &self.summary().markdown();
        out += "\n## Errors by kind of ray\n\nOf rows with equal figures the first stands for all.\n\n";
        out += &self.errors().markdown();
        out += "\n## How far off\n\n\
                By how much distances along the ray differ from the exact ones, in parts of the diagonal of the scene's box, over all \
                kinds of rays: of right answers on the exact triangle and on another, of rounded ones, which pass an outline and may be \
                anywhere, and of wrong ones. Of rows with equal figures the first stands for all.\n\n";
        out += &self.sizes().markdown();
        if let Some(picture) = &self.picture {
            out += &picture.markdown();
        }
        out
    }

    /// A row by its number.
    pub fn row(&self, number: usize) -> Option<&Row> {
        self.rows.iter().find(|row| row.number == number)
    }
}

/// Marks fields, optimal rows, and when each pays back.
pub fn conclude(rows: &mut [Row]) {
    let most = rows.iter().filter_map(|row| row.threads).max().unwrap_or(1);
    for row in rows.iter_mut() {
        let single = row.threads == Some(1) && most > 1;
        row.field = if single { ONE_THREAD } else { ALL_THREADS }.to_owned();
    }
    for field in [ALL_THREADS, ONE_THREAD] {
        let places: Vec<usize> = (0..rows.len()).filter(|&i| rows[i].field == field).collect();
        let standings = pareto::standings(
            places.len(),
            |i, j| rows[places[i]].compare(&rows[places[j]]),
            |i, j| rows[places[i]].compare_medians(&rows[places[j]]),
        );
        for (place, standing) in places.into_iter().zip(standings) {
            rows[place].pareto = standing;
        }
    }
    let base = |row: &Row| {
        rows.iter().find(|other| {
            other.name == "fast"
                && other.accuracy == row.accuracy
                && other.backend == row.backend
                && other.threads == row.threads
        })
    };
    let paybacks: Vec<Payback> = rows
        .iter()
        .map(|row| match base(row) {
            None => Payback::Unknown,
            Some(base) if base.number == row.number => Payback::Base,
            Some(base) => row.payback_against(base),
        })
        .collect();
    for (row, payback) in rows.iter_mut().zip(paybacks) {
        row.payback = payback;
    }
}
