//! Rows as points by two of their figures.

use super::axis::Axis;
use super::draw::{
    COLOURS, LINE, Marker, SMALL, Shape, frame, label_size, labels, marker, text, title,
};
use super::place::place;
use crate::paper::plot::style::{GREY, INK, bold, letters};
use crate::paper::plot::{Area, Drawn, Plot};
use crate::trade::document::Trade;
use crate::trade::interval::Interval;
use crate::trade::pareto::{self, Standing};
use crate::trade::row::ALL_THREADS;
use crate::trade::row::Row;
use plotters::prelude::{DrawingBackend, PathElement};
use plotters::style::Color;
use plotters::style::text_anchor::{HPos, VPos};

/// A point: a row, and its two figures.
#[derive(Clone, Debug, PartialEq)]
struct Point {
    number: usize,
    words: String,
    at: [f64; 2],
    /// Where the figures lie, for times.
    spans: [Option<Interval>; 2],
    look: Marker,
    /// Whether its number stands beside it.
    labelled: bool,
}

/// A plot of rows.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Scatter {
    pub(super) title: String,
    means: [&'static str; 2],
    /// Whether the second figure is mostly 0.
    with_zero: bool,
    /// What else a reader should know.
    note: &'static str,
    points: Vec<Point>,
}

/// The plot's rectangle; its legend is to the right.
const FRAME: [i32; 4] = [104, 64, 900, 800];
/// Most lines of the legend that name points.
const NAMED: usize = 26;

impl Scatter {
    /// The plots of a report with the names of their files.
    pub(super) fn all(trade: &Trade) -> Vec<(&'static str, Scatter)> {
        let shown = || trade.rows.iter().filter(|row| row.field == ALL_THREADS);
        let scene = &trade.scene.name;
        // A tree is one point, whatever is traced through it.
        let mut trees: Vec<&Row> = Vec::new();
        for row in shown() {
            if !trees.iter().any(|tree| tree.name == row.name && tree.backend == row.backend) {
                trees.push(row);
            }
        }
        let of_tree =
            |row: &Row| row.name.clone() + if row.threads.is_none() { "; wgpu" } else { "" };
        let build = Scatter {
            title: format!("Build against trace: {scene}"),
            means: ["milliseconds to build", "nanoseconds a ray, mean of the four sets"],
            with_zero: false,
            note: "to the lower left is better; bars: intervals",
            points: points(
                shown(),
                Row::short_title,
                |row| [row.build_ms, row.ns_per_ray],
                |row| [Some(row.build_interval), Some(row.ns_interval)],
            ),
        };
        let errors = Scatter {
            title: format!("Errors against trace: {scene}"),
            means: [
                "nanoseconds a ray, mean of the four sets",
                "missing, wrong and phantom hits a million rays",
            ],
            with_zero: true,
            note: "to the lower left is better; 0 at the bottom; bars: intervals",
            points: points(
                shown(),
                Row::short_title,
                |row| [row.ns_per_ray, row.errors_per_million],
                |row| [Some(row.ns_interval), None],
            ),
        };
        let most = trees.iter().map(|row| row.query_bytes).max().unwrap_or(0);
        let (unit, bytes) = match most < 1_000_000 {
            true => (1e3, "kilobytes that queries read"),
            false => (1e6, "megabytes that queries read"),
        };
        let memory = Scatter {
            title: format!("Memory against quality: {scene}"),
            means: ["SAH cost at the constants of preset fast", bytes],
            with_zero: false,
            note: "to the lower left is better; a point a tree",
            points: points(
                trees.into_iter(),
                of_tree,
                |row| [row.sah_cost, row.query_bytes as f64 / unit],
                |_| [None; 2],
            ),
        };
        let memory = memory.without_accuracy();
        vec![("build-trace", build), ("error-trace", errors), ("memory-quality", memory)]
    }

    /// Points that stand for trees, whatever is traced through them.
    fn without_accuracy(mut self) -> Scatter {
        for point in &mut self.points {
            point.look.shape = Shape::Circle;
        }
        self
    }

    fn axes(&self) -> [Axis; 2] {
        let ends = |point: &Point, k: usize| match point.spans[k] {
            Some(Interval { low, high }) => [low, high],
            None => [point.at[k]; 2],
        };
        let values =
            |k: usize| self.points.iter().flat_map(|point| ends(point, k)).collect::<Vec<f64>>();
        let [left, top, right, bottom] = FRAME;
        let x = Axis::around(&values(0), left, right);
        let y = match self.with_zero {
            true => Axis::with_zero(&values(1), bottom - 24, top),
            false => Axis::around(&values(1), bottom, top),
        };
        [x, y]
    }

    /// For each point with a number, the one before it that stands on the same spot, if any: one number
    /// there is enough.
    fn same(&self) -> Vec<Option<usize>> {
        const NEAR: i32 = 3;
        let [x, y] = self.axes();
        let at: Vec<(i32, i32)> =
            self.points.iter().map(|point| (x.pixel(point.at[0]), y.pixel(point.at[1]))).collect();
        let mut first: Vec<usize> = Vec::new();
        let mut out = vec![None; at.len()];
        for (i, own) in at.iter().enumerate().filter(|(i, _)| self.points[*i].labelled) {
            let near = |other: &&usize| {
                let other = at[**other];
                (own.0 - other.0).abs() <= NEAR && (own.1 - other.1).abs() <= NEAR
            };
            out[i] = first.iter().find(near).copied();
            if out[i].is_none() {
                first.push(i);
            }
        }
        out
    }

    fn legend<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let (width, _) = area.dim_in_pixel();
        let (left, right) = (FRAME[2] + 28, width as i32 - 16);
        let small = || letters(SMALL, INK, HPos::Left, VPos::Center);
        let plain = Marker { shape: Shape::Circle, colour: INK, filled: true, ringed: false };
        let present = |find: &dyn Fn(&Point) -> bool| self.points.iter().any(find);
        let mut keys: Vec<(Marker, &str)> = Vec::new();
        for (colour, name) in COLOURS.into_iter().zip(["fast", "balanced", "best", "narrow"]) {
            if present(&|point| point.look.colour == colour) {
                keys.push((Marker { colour, ..plain }, name));
            }
        }
        let mut y = FRAME[1] + 8;
        text(area, "preset", (left, y), bold(SMALL, INK, HPos::Left, VPos::Center), 100)?;
        let row = |keys: Vec<(Marker, &str)>, y: &mut i32| -> Drawn {
            for (place, (look, name)) in keys.into_iter().enumerate() {
                if place > 0 && place % 3 == 0 {
                    *y += LINE;
                }
                let x = left + 110 + 140 * (place as i32 % 3);
                marker(area, (x, *y), look)?;
                text(area, name, (x + 14, *y), small(), 116)?;
            }
            *y += LINE + 4;
            Ok(())
        };
        row(keys, &mut y)?;
        let shapes =
            [(Shape::Triangle, "fast"), (Shape::Circle, "watertight"), (Shape::Square, "exact")];
        let shapes = shapes.into_iter().filter(|(shape, _)| present(&|p| p.look.shape == *shape));
        let shapes: Vec<(Marker, &str)> =
            shapes.map(|(shape, name)| (Marker { shape, ..plain }, name)).collect();
        if shapes.len() > 1 {
            text(area, "accuracy", (left, y), bold(SMALL, INK, HPos::Left, VPos::Center), 100)?;
            row(shapes, &mut y)?;
        }
        text(area, "kind", (left, y), bold(SMALL, INK, HPos::Left, VPos::Center), 100)?;
        let mut kinds =
            vec![(plain, "preset"), (Marker { filled: false, ..plain }, "a knob turned")];
        if present(&|point| point.look.ringed) {
            kinds.push((Marker { ringed: true, ..plain }, "on the GPU"));
        }
        row(kinds, &mut y)?;
        area.draw(&PathElement::new([(left, y), (right, y)], GREY.stroke_width(1)))?;
        y += LINE - 4;
        let same = self.same();
        for (i, point) in self.points.iter().enumerate().filter(|(_, point)| point.labelled) {
            let words = match same[i] {
                None => point.words.clone(),
                Some(other) => format!("{} (at {})", point.words, self.points[other].number),
            };
            let number = point.number.to_string();
            text(area, &number, (left + 26, y), bold(SMALL, INK, HPos::Right, VPos::Center), 40)?;
            marker(area, (left + 42, y), point.look)?;
            text(area, &words, (left + 58, y), small(), right - left - 58)?;
            y += LINE;
        }
        let unnamed = self.points.iter().filter(|point| !point.labelled).count();
        let note = match unnamed {
            0 => self.note.to_owned(),
            count => format!("{}; {count} without a number are in the table", self.note),
        };
        text(
            area,
            &note,
            (left, y + 8),
            letters(SMALL, GREY, HPos::Left, VPos::Center),
            right - left,
        )
    }
}

/// Rows as points; labelled are presets as they are, and what no other point beats in both figures.
fn points<'a>(
    rows: impl Iterator<Item = &'a Row>,
    words: impl Fn(&Row) -> String,
    at: impl Fn(&Row) -> [f64; 2],
    spans: impl Fn(&Row) -> [Option<Interval>; 2],
) -> Vec<Point> {
    let colour = |preset: &str| match preset {
        "fast" => COLOURS[0],
        "balanced" => COLOURS[1],
        "narrow" => COLOURS[3],
        _ => COLOURS[2],
    };
    let mut points: Vec<Point> = rows
        .map(|row| Point {
            number: row.number,
            words: words(row),
            at: at(row),
            spans: spans(row),
            look: Marker {
                shape: Shape::of(&row.accuracy),
                colour: colour(&row.preset),
                filled: row.knob.is_none(),
                ringed: row.threads.is_none(),
            },
            labelled: row.knob.is_none(),
        })
        .collect();
    let places: Vec<[f64; 2]> = points.iter().map(|point| point.at).collect();
    let compare =
        |i: usize, j: usize| [0, 1].map(|axis| places[i][axis].total_cmp(&places[j][axis]));
    for (point, standing) in
        points.iter_mut().zip(pareto::standings(places.len(), compare, compare))
    {
        point.labelled |= standing != Standing::Beaten;
    }
    let beyond = points.iter().enumerate().filter(|(_, point)| point.labelled).map(|(i, _)| i);
    for place in beyond.skip(NAMED).collect::<Vec<usize>>() {
        points[place].labelled = false;
    }
    points
}

impl Plot for Scatter {
    const SIZE: (u32, u32) = (1500, 880);

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let [x, y] = self.axes();
        title(area, &self.title)?;
        frame(area, FRAME, (&x, self.means[0]), (&y, self.means[1]))?;
        let pixels: Vec<(i32, i32)> =
            self.points.iter().map(|point| (x.pixel(point.at[0]), y.pixel(point.at[1]))).collect();
        let same = self.same();
        let wanted: Vec<(usize, (i32, i32))> = (0..self.points.len())
            .filter(|&i| self.points[i].labelled && same[i].is_none())
            .map(|i| (i, label_size(area, &self.points[i].number.to_string())))
            .collect();
        let placed = place(&pixels, &wanted, &[], FRAME);
        labels(area, &pixels, &placed, |point| self.points[point].number.to_string())?;
        for (point, &(column, line)) in self.points.iter().zip(&pixels) {
            let bar = point.look.colour.mix(0.45).stroke_width(1);
            if let Some(Interval { low, high }) = point.spans[0] {
                let bar_ends = [(x.pixel(low), line), (x.pixel(high), line)];
                area.draw(&PathElement::new(bar_ends, bar))?;
            }
            if let Some(Interval { low, high }) = point.spans[1] {
                let bar_ends = [(column, y.pixel(low)), (column, y.pixel(high))];
                area.draw(&PathElement::new(bar_ends, bar))?;
            }
        }
        // Those without a number first: those with one are to be seen.
        for labelled in [false, true] {
            for (point, &at) in self.points.iter().zip(&pixels) {
                if point.labelled == labelled {
                    marker(area, at, point.look)?;
                }
            }
        }
        self.legend(area)
    }
}
