//! Table 4 as a picture: what a frame's rays take, frame by frame.

use super::style::{BLUE, FAINT, GREY, INK, ORANGE, TEXT, TITLE, letters};
use super::{Area, Drawn, Plot};
use crate::paper::motion::{Course, Motion, Update};
use plotters::chart::{ChartBuilder, SeriesLabelPosition};
use plotters::prelude::{Circle, DrawingBackend, LineSeries, PathElement};
use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{Color, WHITE};

impl Motion {
    /// The courses that are drawn: the first tree by preset `fast`, the hierarchy refitted and built anew.
    fn drawn(&self) -> impl Iterator<Item = &Course> {
        let ours = self.courses.iter().find(|course| course.preset == Some("fast"));
        ours.into_iter().chain(self.courses.iter().filter(|course| course.preset.is_none()))
    }
}

impl Plot for Motion {
    const SIZE: (u32, u32) = (1000, 700);

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let all = || self.drawn().flat_map(|course| &course.frames);
        let top = 1.3 * all().map(|took| took.rays_ms).fold(1e-9, f64::max);
        let last = self.drawn().map(|course| course.frames.len()).max().unwrap_or(1).max(2) - 1;
        let mut chart = ChartBuilder::on(area)
            .caption(
                format!("{}: the rays of each frame", self.scene),
                letters(TITLE, INK, HPos::Left, VPos::Top),
            )
            .margin(18)
            .x_label_area_size(52)
            .y_label_area_size(84)
            .build_cartesian_2d(0.0..last as f64, 0.0..top)?;
        let text = letters(TEXT, INK, HPos::Left, VPos::Top);
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .bold_line_style(FAINT)
            .axis_style(GREY)
            .label_style(text.clone())
            .x_desc("frame")
            .y_desc("milliseconds")
            .x_labels(last + 1)
            .x_label_formatter(&|frame| format!("{frame:.0}"))
            .draw()?;
        for course in self.drawn() {
            let (colour, words) = match (course.preset, course.update) {
                (Some(_), _) => (BLUE, "kd-tree by preset fast, built for each frame"),
                (None, Update::Refitted) => (ORANGE, "BVH of the first frame, refitted"),
                (None, Update::Built) => (GREY, "BVH, built for each frame"),
            };
            let points =
                || course.frames.iter().enumerate().map(|(i, took)| (i as f64, took.rays_ms));
            chart
                .draw_series(LineSeries::new(points(), colour.stroke_width(2)))?
                .label(words)
                .legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 22, y)], colour.stroke_width(2))
                });
            chart.draw_series(points().map(|at| Circle::new(at, 4, colour.filled())))?;
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperLeft)
            .label_font(text)
            .background_style(WHITE)
            .border_style(FAINT)
            .margin(12)
            .draw()?;
        Ok(())
    }
}
