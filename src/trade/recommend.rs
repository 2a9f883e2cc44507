//! Which setting to take for so many rays a build.

use super::payback::{Line, Reign, count, envelope};
use super::row::Row;
use serde::{Deserialize, Serialize};
use splitplane_core::ray::Accuracy;

/// What a user wants to do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wish {
    /// Rays of a frame.
    pub rays: u64,
    /// Frames.
    pub frames: u64,
    /// Whether one build serves all frames, since nothing moves; else each frame has its own.
    pub still: bool,
    /// The accuracy that promises least of those that will do.
    pub least_accuracy: String,
    /// Most missing, wrong and phantom hits for each million of the judged rays.
    pub max_error: Option<f64>,
}

impl Wish {
    /// Rays traced through each build.
    pub fn rays_per_build(&self) -> f64 {
        self.rays as f64 * if self.still { self.frames as f64 } else { 1.0 }
    }

    /// Builds.
    pub fn builds(&self) -> u64 {
        if self.still { 1 } else { self.frames }
    }
}

/// What to take, and the figures that say so.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recommendation {
    /// What was asked.
    pub wish: Wish,
    /// The row's number; none where no row will do.
    pub row: Option<usize>,
    /// Milliseconds for all frames by that row.
    pub total_ms: Option<f64>,
    /// The row that comes next among those of other trees.
    pub next: Option<usize>,
    /// Its milliseconds.
    pub next_total_ms: Option<f64>,
    /// All of it in words.
    pub words: String,
}

/// From so many rays a build on, a row is the one to take.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Rays.
    pub from_rays: f64,
    /// The row's number.
    pub row: usize,
}

/// Totals closer than this are the same on a machine that others use too.
const NOISE: f64 = 0.05;

/// Whether a row will do for a wish, whatever it costs.
pub fn will_do(row: &Row, wish: &Wish) -> bool {
    let rank = |name: &str| Accuracy::ALL.iter().position(|own| own.name() == name);
    rank(&row.accuracy) >= rank(&wish.least_accuracy)
        && wish.max_error.is_none_or(|most| row.errors_per_million <= most)
        && !is_single(row)
}

/// Rows of one thread are for comparison where there are more.
fn is_single(row: &Row) -> bool {
    row.field == super::document::ONE_THREAD
}

/// Who is least for how many rays a build.
pub fn steps(rows: &[Row], wish: &Wish) -> Vec<Step> {
    let usable: Vec<&Row> = rows.iter().filter(|row| will_do(row, wish)).collect();
    let lines: Vec<Line> = usable.iter().map(|row| row.line()).collect();
    let step = |reign: Reign| Step { from_rays: reign.from, row: usable[reign.line].number };
    envelope(&lines).into_iter().map(step).collect()
}

/// The row that takes least for all frames: builds + rays.
pub fn recommend(rows: &[Row], wish: &Wish) -> Recommendation {
    let rays = wish.rays_per_build();
    let total = |row: &Row| wish.builds() as f64 * row.total_ms(rays);
    let mut usable: Vec<&Row> = rows.iter().filter(|row| will_do(row, wish)).collect();
    usable.sort_by(|a, b| total(a).total_cmp(&total(b)).then(a.number.cmp(&b.number)));
    let best = usable.first().copied();
    let next = best.and_then(|best| {
        usable.iter().copied().find(|row| row.name != best.name || row.backend != best.backend)
    });
    let words = match best {
        None => nothing(rows, wish),
        Some(best) => in_words(best, next, wish, &total),
    };
    Recommendation {
        wish: wish.clone(),
        row: best.map(|row| row.number),
        total_ms: best.map(total),
        next: next.map(|row| row.number),
        next_total_ms: next.map(total),
        words,
    }
}

fn in_words(best: &Row, next: Option<&Row>, wish: &Wish, total: &dyn Fn(&Row) -> f64) -> String {
    let rays = wish.rays_per_build();
    let (traced, all) = (rays * best.ns_per_ray * 1e-6, total(best));
    let builds = wish.builds();
    let mut out = format!(
        "For {} rays through each of {builds} build{}: {} (row {}). {} ms to build and {} ms to trace \
         at {:.0} ns a ray, {} ms in all, {:.0} % of it building; {} MB; {} wrong answers a million.",
        count(rays),
        if builds == 1 { "" } else { "s" },
        best.title(),
        best.number,
        short(best.build_ms),
        short(traced),
        best.ns_per_ray,
        short(all),
        100.0 * best.build_ms / best.total_ms(rays).max(f64::MIN_POSITIVE),
        short(best.query_bytes as f64 / 1e6),
        short(best.errors_per_million),
    );
    if let Some(next) = next {
        let more = total(next) / all - 1.0;
        out += &format!(
            " Next comes {} (row {}) with {} ms, {:.0} % more{}.",
            next.title(),
            next.number,
            short(total(next)),
            100.0 * more,
            if more < NOISE {
                ": within the noise of most machines, so either will do"
            } else {
                ""
            }
        );
    }
    if !wish.still && wish.frames > 1 {
        out += " Every frame has a build of its own, so the number of frames does not change the choice.";
    }
    out
}

fn nothing(rows: &[Row], wish: &Wish) -> String {
    let least = Wish { max_error: None, ..wish.clone() };
    let errors = rows.iter().filter(|row| will_do(row, &least)).map(|row| row.errors_per_million);
    match (errors.min_by(f64::total_cmp), wish.max_error) {
        (Some(least), Some(most)) => format!(
            "No setting of accuracy {} or better gives {} wrong answers a million or fewer; the least \
             measured is {}.",
            wish.least_accuracy,
            short(most),
            short(least)
        ),
        _ => format!("No setting of accuracy {} or better was measured.", wish.least_accuracy),
    }
}

/// A number with three digits or so.
pub(super) fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        x if x >= 100.0 => format!("{value:.0}"),
        x if x >= 10.0 => format!("{value:.1}"),
        x if x >= 0.1 => format!("{value:.2}"),
        x if x >= 1e-3 => format!("{value:.4}"),
        _ => format!("{value:.1e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::row::tests::row;
    use super::*;

    fn wish(rays: u64) -> Wish {
        let least_accuracy = "watertight".to_owned();
        Wish { rays, frames: 1, still: false, least_accuracy, max_error: None }
    }

    /// A cheap build, a dear one that pays after a million rays, and a leaky one that beats both.
    fn rows() -> Vec<Row> {
        let mut rows = vec![
            row("fast", "watertight", 100.0, 200.0),
            row("best", "watertight", 200.0, 100.0),
            row("fast", "fast", 10.0, 10.0),
        ];
        rows[0].errors_per_million = 3.0;
        rows[2].errors_per_million = 5000.0;
        for (i, row) in rows.iter_mut().enumerate() {
            row.number = i + 1;
        }
        rows
    }

    #[test]
    fn few_rays_want_a_cheap_build_and_many_a_good_tree() {
        let rows = rows();
        assert_eq!(recommend(&rows, &wish(999_999)).row, Some(1));
        assert_eq!(recommend(&rows, &wish(1_000_001)).row, Some(2));
        let found: Vec<(f64, usize)> =
            steps(&rows, &wish(1)).iter().map(|step| (step.from_rays, step.row)).collect();
        assert_eq!(found, [(0.0, 1), (1e6, 2)]);
    }

    #[test]
    fn frames_matter_where_one_build_serves_them_all() {
        let rows = rows();
        let moving = Wish { frames: 100, ..wish(20_000) };
        let found = recommend(&rows, &moving);
        assert_eq!(found.row, Some(1));
        assert!((found.total_ms.unwrap() - 100.0 * (100.0 + 4.0)).abs() < 1e-9);
        let found = recommend(&rows, &Wish { still: true, ..moving });
        assert_eq!(found.row, Some(2));
        assert!((found.total_ms.unwrap() - (200.0 + 200.0)).abs() < 1e-9);
    }

    #[test]
    fn leaks_only_for_whoever_asks_for_them() {
        let rows = rows();
        assert_eq!(recommend(&rows, &wish(1000)).row, Some(1));
        let leaky = Wish { least_accuracy: "fast".into(), ..wish(1000) };
        assert_eq!(recommend(&rows, &leaky).row, Some(3));
        let strict = Wish { max_error: Some(2.0), ..wish(1000) };
        assert_eq!(recommend(&rows, &strict).row, Some(2));
        let exact = Wish { least_accuracy: "exact".into(), ..wish(1000) };
        let none = recommend(&rows, &exact);
        assert_eq!((none.row, none.total_ms), (None, None));
        assert!(none.words.contains("No setting of accuracy exact"), "{}", none.words);
        let none = recommend(&rows[..1], &strict);
        assert!(none.words.contains("the least measured is 3"), "{}", none.words);
    }

    #[test]
    fn a_row_of_one_thread_is_not_for_taking() {
        let mut rows = rows();
        rows[0].field = super::super::document::ONE_THREAD.to_owned();
        assert_eq!(recommend(&rows, &wish(1)).row, Some(2));
    }
}
