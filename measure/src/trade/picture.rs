//! What a picture loses by fewer samples, shorter paths, and paths that end when they matter little.
//!
//! Each knob is turned alone. Samples are held against the most there can be. Depth and least weight are held against
//! the deepest paths of any weight through the very same samples, so that only what they leave out counts.

use super::TradeError;
use crate::paper::ReportError;
use crate::paper::scene::Placed;
use crate::paper::table::{Cell, Table};
use crate::paper::timing::timed;
use serde::{Deserialize, Serialize};
use splitplane::tracer::{FrameRequest, Tracer};
use splitplane_core::backend::BuildOptions;
use splitplane_core::error::QueryError;
use splitplane_core::ray::QueryOptions;
use splitplane_core::watch::{Progress, Stage, Watch};
use splitplane_cpu::CpuBackend;
use splitplane_render::{MAX_DEPTH, MAX_SAMPLES, Outputs, RenderSettings, Size};

/// Samples a pixel that are tried.
const SAMPLES: [u32; 4] = [1, 4, 16, 32];
/// Depths.
const DEPTHS: [u32; 5] = [0, 1, 2, 4, 8];
/// Least weights.
const WEIGHTS: [f32; 4] = [0.25, 0.0625, 1.0 / 64.0, 1.0 / 256.0];
/// Samples of pictures whose depth or least weight is tried.
const FEW: u32 = 4;

/// A knob of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Knob {
    /// Camera rays a pixel.
    Samples,
    /// Most reflections and refractions along a path.
    Depth,
    /// The weight below which paths end.
    Weight,
}

impl Knob {
    /// As the option of `splitplane render` is named.
    pub const fn option(self) -> &'static str {
        match self {
            Knob::Samples => "--samples",
            Knob::Depth => "--depth",
            Knob::Weight => "--min-weight",
        }
    }
}

/// A picture beside the one it is held against.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PictureRow {
    /// The knob that is turned.
    pub knob: Knob,
    /// Its value.
    pub value: f64,
    /// Rays of the frame, those towards lights included.
    pub rays: u64,
    /// Milliseconds for the frame: the lesser of two.
    pub ms: f64,
    /// Milliseconds over those of the picture it is held against.
    pub part_of_time: f64,
    /// The root of the mean square of differences of colour values as they are shown, 0 to 255.
    pub root_mean_square: f64,
    /// The greatest difference of a value, in the same unit.
    pub greatest: u8,
    /// Part of the pixels in which a value differs by more than [`PictureTrade::SEEN`].
    pub seen: f64,
}

/// Pictures of a scene at several settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PictureTrade {
    /// Pixels from left to right and from top to bottom.
    pub size: [u32; 2],
    /// A row each setting.
    pub rows: Vec<PictureRow>,
}

/// A frame and what it took.
struct Frame {
    pixels: Vec<[u8; 4]>,
    rays: u64,
    ms: f64,
}

impl PictureTrade {
    /// Differences that are likely seen, in the unit of colour values.
    pub const SEEN: u8 = 8;

    /// Draws the scene on the CPU.
    ///
    /// # Errors
    /// A tree or frame that cannot be made; `Cancelled` by `watch`, which is asked before each frame.
    pub fn measure(
        placed: &Placed,
        size: Size,
        max_memory: Option<u64>,
        watch: &dyn Watch,
    ) -> Result<PictureTrade, TradeError> {
        let options = BuildOptions { max_memory, ..BuildOptions::default() };
        let (mesh, appearance) = (placed.scene.mesh()?, placed.scene.appearance());
        let mut tracer = Tracer::load(CpuBackend::new(), &mesh, &appearance, &options)
            .map_err(ReportError::from)?;
        let total = (SAMPLES.len() + DEPTHS.len() + WEIGHTS.len() + 2) as u64;
        let mut done = 0;
        let mut frame = |samples, depth, minimum_weight| {
            let progress = Progress { stage: Stage::Rays, done, total };
            if watch.progress(&progress).is_break() {
                return Err(TradeError::from(QueryError::Cancelled { done, total }));
            }
            done += 1;
            let settings = RenderSettings { minimum_weight, ..placed.settings(samples, depth) };
            draw(&mut tracer, placed, size, settings)
        };
        let mut rows = Vec::new();
        let usual = RenderSettings::default();
        let best = frame(MAX_SAMPLES, usual.depth, usual.minimum_weight)?;
        for samples in SAMPLES {
            let own = frame(samples, usual.depth, usual.minimum_weight)?;
            rows.push(PictureRow::of(Knob::Samples, samples.into(), &own, &best));
        }
        let whole = frame(FEW, MAX_DEPTH, 0.0)?;
        for depth in DEPTHS {
            let own = frame(FEW, depth, 0.0)?;
            rows.push(PictureRow::of(Knob::Depth, depth.into(), &own, &whole));
        }
        for weight in WEIGHTS {
            let own = frame(FEW, MAX_DEPTH, weight)?;
            rows.push(PictureRow::of(Knob::Weight, weight.into(), &own, &whole));
        }
        Ok(PictureTrade { size: [size.width(), size.height()], rows })
    }

    /// What it shows, as a part of a report.
    pub fn markdown(&self) -> String {
        let [width, height] = self.size;
        let mut out = format!(
            "\n## What a picture loses\n\nPictures of {width} x {height} pixels by `splitplane render`'s tracer on the CPU, one \
             knob turned at a time. Samples are held against {MAX_SAMPLES} a pixel, which are these and more, so the error against endless samples is greater: by \
             41 % at 32 and 15 % at 16 if samples were independent; depth and least weight against depth \
             {MAX_DEPTH} and least weight 0 with the same {FEW} samples. Differences are of colour values as they are shown, 0 to \
             255; the last column has the pixels with one of more than {}.\n\n",
            PictureTrade::SEEN
        );
        let head =
            ["option", "value", "ms", "of the time, %", "rays", "RMS", "at most", "pixels off, %"];
        let mut table = Table::new(&head);
        for row in &self.rows {
            table.push(vec![
                row.knob.option().into(),
                row.value.to_string().into(),
                Cell::Number(row.ms, 1),
                Cell::Number(100.0 * row.part_of_time, 1),
                Cell::Count(row.rays),
                Cell::Number(row.root_mean_square, 2),
                Cell::Count(row.greatest.into()),
                Cell::Number(100.0 * row.seen, 2),
            ]);
        }
        out += &table.markdown();
        let paths = |row: &&PictureRow| row.knob != Knob::Samples;
        if self.rows.iter().filter(paths).all(|row| row.greatest == 0) {
            out += "\nDepth and least weight change no pixel: what the camera sees neither mirrors nor refracts.\n";
        }
        out
    }
}

impl PictureRow {
    fn of(knob: Knob, value: f64, own: &Frame, best: &Frame) -> PictureRow {
        let (mut squares, mut greatest, mut seen) = (0u64, 0, 0u64);
        for (own, best) in own.pixels.iter().zip(&best.pixels) {
            let apart = [0, 1, 2].map(|channel| own[channel].abs_diff(best[channel]));
            squares += apart.into_iter().map(|x| u64::from(x).pow(2)).sum::<u64>();
            let most = apart.into_iter().max().unwrap_or(0);
            greatest = greatest.max(most);
            seen += u64::from(most > PictureTrade::SEEN);
        }
        let pixels = own.pixels.len().max(1) as f64;
        PictureRow {
            knob,
            value,
            rays: own.rays,
            ms: own.ms,
            part_of_time: own.ms / best.ms.max(f64::MIN_POSITIVE),
            root_mean_square: (squares as f64 / (3.0 * pixels)).sqrt(),
            greatest,
            seen: seen as f64 / pixels,
        }
    }
}

/// A frame, drawn twice: the first time warms up.
fn draw(
    tracer: &mut Tracer,
    placed: &Placed,
    size: Size,
    settings: RenderSettings,
) -> Result<Frame, TradeError> {
    let request = FrameRequest {
        camera: placed.camera.pinhole(size),
        size,
        settings,
        outputs: Outputs::PIXELS,
        query: QueryOptions::default(),
    };
    let mesh = placed.scene.mesh()?;
    let (warm, first) = timed(|| tracer.frame(&mesh, &request).map(|_| ()));
    warm.map_err(ReportError::from)?;
    let (made, second) = timed(|| tracer.frame(&mesh, &request));
    let made = made.map_err(ReportError::from)?;
    let pixels = made.pixels().map_err(ReportError::from)?;
    let pixels = pixels.iter().map(|pixel| pixel.to_le_bytes()).collect();
    Ok(Frame { pixels, rays: made.stats().rays(), ms: first.min(second) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_by_hand() {
        let frame = |value: u8, ms| Frame {
            pixels: vec![[value, 10, 10, 255], [10, 10, 10, 255]],
            rays: 7,
            ms,
        };
        let row = PictureRow::of(Knob::Depth, 2.0, &frame(22, 3.0), &frame(10, 12.0));
        // One of six values differs by 12.
        assert!((row.root_mean_square - (144.0f64 / 6.0).sqrt()).abs() < 1e-12, "{row:?}");
        assert_eq!((row.greatest, row.seen, row.part_of_time), (12, 0.5, 0.25));
        let row = PictureRow::of(Knob::Depth, 2.0, &frame(18, 3.0), &frame(10, 12.0));
        assert_eq!((row.greatest, row.seen), (8, 0.0), "not seen yet");
    }
}
