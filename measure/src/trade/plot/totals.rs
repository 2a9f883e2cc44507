//! What a build and its rays take together, by the number of rays, and where lines cross.

use super::axis::Axis;
use super::draw::{COLOURS, LINE, SMALL, frame, label_size, labels, text, title};
use super::place::place;
use crate::paper::plot::style::{GREY, INK, bold, letters};
use crate::paper::plot::{Area, Drawn, Plot};
use crate::trade::document::Trade;
use crate::trade::payback::{Line, Payback, count};
use crate::trade::row::ALL_THREADS;
use plotters::prelude::{Circle, DrawingBackend, PathElement, RGBColor};
use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{Color, WHITE};

/// A row as a line.
#[derive(Clone, Debug, PartialEq)]
struct Course {
    number: usize,
    words: String,
    line: Line,
    colour: RGBColor,
}

/// Where two lines cross, by their places.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Crossing {
    rays: f64,
    from: usize,
    to: usize,
}

/// Total time against the number of rays: in milliseconds above, relative to the first line below.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Totals {
    pub(super) title: String,
    courses: Vec<Course>,
    crossings: Vec<Crossing>,
    wish: f64,
}

const ABOVE: [i32; 4] = [104, 64, 900, 450];
const BELOW: [i32; 4] = [104, 540, 900, 860];
/// Most lines: as many as there are colours.
const MOST: usize = COLOURS.len();
/// Points of a line.
const STEPS: usize = 240;

impl Totals {
    /// Preset `fast` first, then the other presets, then whoever is least for some number of rays. None
    /// where nothing was measured that will do.
    pub(super) fn of(trade: &Trade) -> Option<Totals> {
        let accuracy = &trade.recommendation.wish.least_accuracy;
        let plain = trade.rows.iter().filter(|row| {
            row.field == ALL_THREADS && row.knob.is_none() && row.accuracy == *accuracy
        });
        let least = trade.steps.iter().filter_map(|step| trade.row(step.row));
        let mut rows: Vec<&crate::trade::row::Row> = Vec::new();
        for row in plain.chain(least) {
            if rows.len() < MOST && !rows.iter().any(|other| other.number == row.number) {
                rows.push(row);
            }
        }
        if rows.is_empty() {
            return None;
        }
        let courses: Vec<Course> = rows
            .iter()
            .zip(COLOURS)
            .map(|(row, colour)| Course {
                number: row.number,
                words: row.short_title(),
                line: row.line(),
                colour,
            })
            .collect();
        let place = |number: usize| courses.iter().position(|course| course.number == number);
        // From one that is least to the next, and where each pays back against the first.
        let steps = trade.steps.windows(2).filter_map(|pair| {
            let (from, to) = (place(pair[0].row)?, place(pair[1].row)?);
            Some(Crossing { rays: pair[1].from_rays, from, to })
        });
        let paybacks =
            (1..courses.len()).filter_map(|to| match rows[to].payback_against(rows[0]) {
                Payback::After { rays, .. } => Some(Crossing { rays, from: 0, to }),
                Payback::Until { rays, .. } => Some(Crossing { rays, from: to, to: 0 }),
                _ => None,
            });
        let mut crossings: Vec<Crossing> = Vec::new();
        for crossing in steps.chain(paybacks) {
            let same = |other: &Crossing| (other.from, other.to) == (crossing.from, crossing.to);
            if (1.0..1e12).contains(&crossing.rays) && !crossings.iter().any(same) {
                crossings.push(crossing);
            }
        }
        crossings.sort_by(|a, b| a.rays.total_cmp(&b.rays));
        Some(Totals {
            title: format!("Total time against rays a build: {}", trade.scene.name),
            courses,
            crossings,
            wish: trade.recommendation.wish.rays_per_build(),
        })
    }

    /// Rays from end to end: wide enough for the wish, for all crossings, and for both ends of the
    /// first line, where the build and where the rays take all of the time.
    fn rays(&self) -> [f64; 2] {
        let first = self.courses[0].line;
        let even = 1e6 * first.build_ms / first.ns_per_ray.max(1e-6);
        let mut ends = [even / 100.0, even * 100.0];
        for rays in self.crossings.iter().map(|crossing| crossing.rays).chain([self.wish]) {
            ends = [ends[0].min(rays / 3.0), ends[1].max(rays * 3.0)];
        }
        [ends[0].max(1.0), ends[1].clamp(10.0, 1e14)]
    }

    fn panel<B: DrawingBackend>(
        &self,
        area: &Area<B>,
        rect: [i32; 4],
        means: &str,
        value: impl Fn(usize, f64) -> f64,
    ) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let [left, top, right, bottom] = rect;
        let ends = self.rays();
        let x = Axis::log(ends[0], ends[1], left, right);
        let at = |step: usize| x.value(step as f64 / STEPS as f64);
        let all: Vec<f64> = (0..self.courses.len())
            .flat_map(|place| (0..=STEPS).step_by(8).map(move |step| (place, step)))
            .map(|(place, step)| value(place, at(step)))
            .collect();
        let y = Axis::around(&all, bottom, top);
        frame(area, rect, (&x, "rays traced through each build"), (&y, means))?;
        let curve = |place: usize| -> Vec<(i32, i32)> {
            (0..=STEPS).map(|step| (x.pixel(at(step)), y.pixel(value(place, at(step))))).collect()
        };
        let curves: Vec<Vec<(i32, i32)>> = (0..self.courses.len()).map(curve).collect();
        for (course, curve) in self.courses.iter().zip(&curves).rev() {
            area.draw(&PathElement::new(curve.clone(), course.colour.stroke_width(2)))?;
        }
        let pixels: Vec<(i32, i32)> = self
            .crossings
            .iter()
            .map(|crossing| (x.pixel(crossing.rays), y.pixel(value(crossing.to, crossing.rays))))
            .collect();
        for &pixel in &pixels {
            area.draw(&Circle::new(pixel, 5, WHITE.filled()))?;
            area.draw(&Circle::new(pixel, 5, INK.stroke_width(2)))?;
        }
        let wanted: Vec<(usize, (i32, i32))> =
            (0..pixels.len()).map(|i| (i, label_size(area, &letter(i)))).collect();
        let placed = place(&pixels, &wanted, &curves, rect);
        labels(area, &pixels, &placed, letter)
    }

    fn legend<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let (width, _) = area.dim_in_pixel();
        let (left, right) = (ABOVE[2] + 28, width as i32 - 16);
        let small = |colour| letters(SMALL, colour, HPos::Left, VPos::Center);
        let mut y = ABOVE[1] + 8;
        let head = |what: &str, y: i32| {
            text(area, what, (left, y), bold(SMALL, INK, HPos::Left, VPos::Center), right - left)
        };
        head("row: preset, knob; accuracy", y)?;
        y += LINE + 4;
        for course in &self.courses {
            let swatch = [(left, y), (left + 28, y)];
            area.draw(&PathElement::new(swatch, course.colour.stroke_width(3)))?;
            let words = format!("{}  {}", course.number, course.words);
            text(area, &words, (left + 40, y), small(INK), right - left - 40)?;
            y += LINE;
        }
        y += LINE;
        head("where lines cross", y)?;
        y += LINE + 4;
        if self.crossings.is_empty() {
            text(
                area,
                "nowhere beyond the noise: one row will do for any number",
                (left, y),
                small(GREY),
                right - left,
            )?;
        }
        for (place, crossing) in self.crossings.iter().enumerate() {
            let [from, to] = [crossing.from, crossing.to].map(|at| self.courses[at].number);
            let words = format!(
                "{}  from {} rays on row {to} takes less than row {from}",
                letter(place),
                count(crossing.rays)
            );
            text(area, &words, (left, y), small(INK), right - left)?;
            y += LINE;
        }
        Ok(())
    }
}

/// A, B, ... Z, AA, ...
fn letter(place: usize) -> String {
    let own = char::from(b'A' + (place % 26) as u8);
    if place < 26 { own.to_string() } else { format!("{}{own}", letter(place / 26 - 1)) }
}

impl Plot for Totals {
    const SIZE: (u32, u32) = (1500, 930);

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        title(area, &self.title)?;
        let total = |place: usize, rays: f64| self.courses[place].line.total_ms(rays);
        self.panel(area, ABOVE, "milliseconds, build and rays", total)?;
        let means = format!("times row {}", self.courses[0].number);
        self.panel(area, BELOW, &means, |place, rays| {
            total(place, rays) / total(0, rays).max(f64::MIN_POSITIVE)
        })?;
        self.legend(area)
    }
}
