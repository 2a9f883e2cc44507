//! Which setting to take for a number of rays per build.

use super::payback::{Line, Reign, count, envelope};
use super::row::{ONE_THREAD, Row};
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
    /// Other presets whose totals are not told apart from the least; the plainest is taken.
    pub alike: Vec<usize>,
    /// The preset that comes next: of those whose totals are not told apart there, the plainest.
    pub next: Option<usize>,
    /// The others that are not told apart from it.
    pub next_alike: Vec<usize>,
    /// Its milliseconds.
    pub next_total_ms: Option<f64>,
    /// The row of a turned knob that takes least of all, where that is told apart.
    pub turned: Option<usize>,
    /// Its milliseconds.
    pub turned_total_ms: Option<f64>,
    /// All of it in words.
    pub words: String,
}

/// From this many rays per build on, a row is the one to take.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Rays.
    pub from_rays: f64,
    /// The row's number.
    pub row: usize,
}

/// Whether a row will do for a wish, whatever it costs.
pub fn will_do(row: &Row, wish: &Wish) -> bool {
    let rank = |name: &str| Accuracy::ALL.iter().position(|own| own.name() == name);
    rank(&row.accuracy) >= rank(&wish.least_accuracy)
        && wish.max_error.is_none_or(|most| row.errors_per_million <= most)
        && !is_single(row)
}

/// Rows of one thread are for comparison where there are more.
fn is_single(row: &Row) -> bool {
    row.field == ONE_THREAD
}

/// Rows whose totals for so many rays a build are told apart from the least by no round, the plainest first: quick
/// builds before slow ones, in the order of the table.
fn least<'a>(rows: &[&'a Row], rays: f64) -> Vec<&'a Row> {
    let least = rows.iter().min_by(|a, b| a.total_ms(rays).total_cmp(&b.total_ms(rays)));
    let Some(least) = least.copied() else { return Vec::new() };
    let alike = |row: &&&Row| !is_less(least, row, rays);
    let mut alike: Vec<&Row> = rows.iter().filter(alike).copied().collect();
    alike.sort_by_key(|row| row.number);
    alike
}

/// Whether a row's total is below another's, beyond the noise of both.
fn is_less(row: &Row, other: &Row, rays: f64) -> bool {
    row.compare_total(other, rays).is_lt()
}

/// Rows that will do, presets as they are before those of turned knobs.
fn usable<'a>(rows: &'a [Row], wish: &Wish) -> [Vec<&'a Row>; 2] {
    let (plain, turned) =
        rows.iter().filter(|row| will_do(row, wish)).partition(|row| row.knob.is_none());
    [plain, turned]
}

/// Which preset to take for how many rays a build; a turned knob only where no preset as it is will do.
pub fn steps(rows: &[Row], wish: &Wish) -> Vec<Step> {
    let [plain, turned] = usable(rows, wish);
    let rows = if plain.is_empty() { turned } else { plain };
    let lines: Vec<Line> = rows.iter().map(|row| row.line()).collect();
    let reigns = envelope(&lines);
    let mut steps: Vec<Step> = Vec::new();
    for (place, reign) in reigns.iter().enumerate() {
        // In the middle of the reign, by ratio.
        let end = reigns.get(place + 1).map_or(4.0 * reign.from, |next: &Reign| next.from);
        let middle = if reign.from > 0.0 { (reign.from * end).sqrt() } else { 0.25 * end };
        let Some(row) = least(&rows, middle).first().map(|row| row.number) else { continue };
        if steps.last().is_none_or(|last| last.row != row) {
            steps.push(Step { from_rays: reign.from, row });
        }
    }
    steps
}

/// The row that takes least for all frames, builds and rays: of presets as they are, the plainest of those that are
/// not told apart. A turned knob that takes less still is named beside it: what it gains holds for this scene.
pub fn recommend(rows: &[Row], wish: &Wish) -> Recommendation {
    let rays = wish.rays_per_build();
    let total = |row: &Row| wish.builds() as f64 * row.total_ms(rays);
    let by_total = |a: &&Row, b: &&Row| total(a).total_cmp(&total(b)).then(a.number.cmp(&b.number));
    let [plain, turned] = usable(rows, wish);
    let (mut candidates, turned) = if plain.is_empty() { (turned, plain) } else { (plain, turned) };
    let alike = least(&candidates, rays);
    let best = alike.first().copied();
    candidates.retain(|row| alike.iter().all(|other| other.number != row.number));
    let after = least(&candidates, rays);
    let next = after.first().copied();
    let after = after.get(1..).unwrap_or_default();
    let turned = turned
        .into_iter()
        .filter(|row| best.is_some_and(|best| is_less(row, best, rays)))
        .min_by(by_total);
    let words = match best {
        None => nothing(rows, wish),
        Some(best) => in_words(best, &alike[1..], (next, after), turned, wish, &total),
    };
    Recommendation {
        wish: wish.clone(),
        row: best.map(|row| row.number),
        total_ms: best.map(total),
        alike: alike.iter().skip(1).map(|row| row.number).collect(),
        next: next.map(|row| row.number),
        next_alike: after.iter().map(|row| row.number).collect(),
        next_total_ms: next.map(total),
        turned: turned.map(|row| row.number),
        turned_total_ms: turned.map(total),
        words,
    }
}

fn in_words(
    best: &Row,
    alike: &[&Row],
    (next, after): (Option<&Row>, &[&Row]),
    turned: Option<&Row>,
    wish: &Wish,
    total: &dyn Fn(&Row) -> f64,
) -> String {
    let rays = wish.rays_per_build();
    let (traced, all) = (rays * best.ns_per_ray * 1e-6, total(best));
    let builds = wish.builds();
    let mut out = format!(
        "For {builds} build{} and {} rays through {}: {} (row {}). {} ms to build and {} ms to trace \
         at {:.0} ns a ray, {} ms in all, {:.0} % of it building; {} MB; {} wrong answers a million.",
        if builds == 1 { "" } else { "s" },
        count(rays),
        if builds == 1 { "it" } else { "each" },
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
    match alike {
        [] => {}
        [other] => {
            out += &format!(
                " {} (row {}) is not told apart from it by these rounds; it is taken since it is plainer.",
                other.title(),
                other.number
            );
        }
        others => {
            out += &format!(
                " Rows {} are not told apart from it by these rounds; it is taken as the plainest of them.",
                numbers(others)
            );
        }
    }
    if let Some(next) = next {
        out += &format!(
            " Next comes {} (row {}) with {} ms, {:.0} % more{}.",
            next.title(),
            next.number,
            short(total(next)),
            100.0 * (total(next) / all - 1.0),
            match after {
                [] => String::new(),
                [row] => format!("; row {} is not told apart from it", row.number),
                rows => format!("; rows {} are not told apart from it", numbers(rows)),
            }
        );
    }
    if let Some(turned) = turned {
        out += &format!(
            " On this scene {} (row {}) takes {} ms, {:.0} % less.",
            turned.title(),
            turned.number,
            short(total(turned)),
            100.0 * (1.0 - total(turned) / all)
        );
    }
    if !wish.still && wish.frames > 1 {
        out += " Every frame has a build of its own, so the number of frames does not change the choice.";
    }
    out
}

/// Numbers of rows in words.
fn numbers(rows: &[&Row]) -> String {
    let numbers: Vec<String> = rows.iter().map(|row| row.number.to_string()).collect();
    numbers.join(", ")
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

    /// A cheap build, an expensive one that pays after a million rays, and a leaky one that beats
    /// both.
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
        assert_eq!(recommend(&rows, &wish(900_000)).row, Some(1));
        // Where the lines cross, they are not told apart.
        assert_eq!(recommend(&rows, &wish(1_000_001)).row, Some(1));
        assert_eq!(recommend(&rows, &wish(1_400_000)).row, Some(2));
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
        rows[0].field = ONE_THREAD.to_owned();
        assert_eq!(recommend(&rows, &wish(1)).row, Some(2));
    }

    #[test]
    fn what_is_not_told_apart_is_not_ranked() {
        let mut rows = rows();
        // Better by 4 %, but each is known to 2 % only.
        rows[1] = Row { number: 2, ..row("balanced", "watertight", 96.0, 192.0) };
        let of = |rows: &[Row], rays| {
            let found = recommend(rows, &wish(rays));
            (found.row, found.alike, found.next, found.turned)
        };
        assert_eq!(of(&rows, 1_000), (Some(1), vec![2], None, None));
        // Better by 10 %.
        rows[1] = Row { number: 2, ..row("balanced", "watertight", 90.0, 180.0) };
        assert_eq!(of(&rows, 1_000), (Some(2), vec![], Some(1), None));
        // Of those that come next and are not told apart, the plainest is named, and the others beside it.
        let mut more = rows.clone();
        more.push(Row { number: 3, ..row("best", "watertight", 99.0, 199.0) });
        more[0].number = 1;
        let found = recommend(&more, &wish(1_000));
        assert_eq!((found.row, found.next, found.next_alike), (Some(2), Some(1), vec![3]));
        assert!(found.words.contains("row 3 is not told apart from it"), "{}", found.words);
        // A turned knob is named, not taken.
        rows[1].knob = Some("T 32".into());
        assert_eq!(of(&rows, 1_000), (Some(1), vec![], None, Some(2)));
        let words = recommend(&rows, &wish(1_000)).words;
        assert!(words.contains("10 % less"), "{words}");
        // Where no preset as it is will do, it is.
        rows[0].errors_per_million = 9.0;
        let strict = Wish { max_error: Some(1.0), ..wish(1_000) };
        assert_eq!(recommend(&rows, &strict).row, Some(2));
    }
}
