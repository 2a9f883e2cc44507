//! Figure 12: how many times faster more processors build.

use super::map::dashes;
use super::style::{BLUE, FAINT, GREY, INK, ORANGE, TEXT, TITLE, letters};
use super::{Area, Drawn, Plot};
use crate::paper::scaling::{Point, Scaling};
use plotters::chart::{ChartBuilder, SeriesLabelPosition};
use plotters::prelude::{Circle, DrawingBackend, EmptyElement, LineSeries, PathElement};
use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{Color, WHITE};

/// Scalings on one backend, at most two.
#[derive(Clone, Copy, Debug)]
pub struct ScalingPlot<'a>(pub &'a [Scaling]);

/// Up to as many processors the axis is linear, beyond it runs by powers of two.
const MOST_LINEAR: usize = 16;

impl Plot for ScalingPlot<'_> {
    const SIZE: (u32, u32) = (1000, 700);

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let points = || self.0.iter().flat_map(|scaling| &scaling.points);
        let most = points().map(|point| point.processors).max().unwrap_or(1);
        let linear = most <= MOST_LINEAR;
        let place = |count: usize| if linear { count as f64 } else { (count.max(1) as f64).log2() };
        let printed = self.0.iter().map(|scaling| scaling.survey_speedup);
        let top = 1.1 * points().map(|point| point.speedup).chain(printed).fold(1.0, f64::max);
        let device = self.0.first().is_some_and(|scaling| scaling.backend != "cpu");
        let software = self.0.iter().any(|scaling| scaling.software);
        let processors = if device { "workgroups of a dispatch" } else { "threads" };
        let (left, right) = (place(1), place(most).max(place(1) + 1.0));
        let pad = 0.03 * (right - left);
        let mut chart = ChartBuilder::on(area)
            .caption(
                format!("Building by preset fast: speed-up over 1 of the {processors}")
                    .replace("1 of the threads", "one thread")
                    .replace("1 of the workgroups of a dispatch", "one workgroup a dispatch")
                    + if software { " (software: the curve means nothing)" } else { "" },
                letters(TITLE, INK, HPos::Left, VPos::Top),
            )
            .margin(18)
            .x_label_area_size(52)
            .y_label_area_size(64)
            .build_cartesian_2d(left - pad..right + pad, 0.0..top)?;
        let text = letters(TEXT, INK, HPos::Left, VPos::Top);
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .bold_line_style(FAINT)
            .axis_style(GREY)
            .label_style(text.clone())
            .x_labels(if linear { most.max(2) } else { MOST_LINEAR })
            .x_desc(processors)
            .y_desc("speed-up")
            .x_label_formatter(&|x| match (x - x.round()).abs() < 1e-9 {
                true if linear => format!("{x:.0}"),
                true => format!("{:.0}", x.exp2()),
                false => String::new(),
            })
            .y_label_formatter(&|speedup| format!("{speedup:.1}"))
            .draw()?;
        for (scaling, colour) in self.0.iter().zip([BLUE, ORANGE]) {
            let at = |point: &Point| (place(point.processors), point.speedup);
            chart
                .draw_series(LineSeries::new(
                    scaling.points.iter().map(at),
                    colour.stroke_width(2),
                ))?
                .label(format!("{}, {} triangles", scaling.scene, scaling.triangles))
                .legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 22, y)], colour.stroke_width(2))
                });
            let circles =
                scaling.points.iter().map(|point| Circle::new(at(point), 5, colour.filled()));
            chart.draw_series(circles)?;
            // What is printed stands at the side: from how many processors is not known.
            let (x0, y) = chart.backend_coord(&(left - pad, scaling.survey_speedup));
            let (x1, _) = chart.backend_coord(&(right + pad, scaling.survey_speedup));
            dashes(area, (x0, y), (x1, y), colour.mix(0.7).stroke_width(1))?;
            chart
                .draw_series(std::iter::once(EmptyElement::at((left, scaling.survey_speedup))))?
                .label(format!("the survey's greatest, {}", scaling.survey_speedup))
                .legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 8, y)], colour.mix(0.7).stroke_width(1))
                });
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::MiddleRight)
            .label_font(text)
            .background_style(WHITE)
            .border_style(FAINT)
            .margin(12)
            .draw()?;
        Ok(())
    }
}
