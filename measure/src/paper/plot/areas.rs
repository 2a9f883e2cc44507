//! Figure 7: lines that meet a box against its surface area.

use super::style::{BLUE, FAINT, GREY, INK, ORANGE, TEXT, TITLE, letters};
use super::{Area, Drawn, Plot};
use crate::paper::areas::Areas;
use plotters::chart::{ChartBuilder, SeriesLabelPosition};
use plotters::prelude::{Circle, DrawingBackend, LineSeries, PathElement};
use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{Color, WHITE};

impl Plot for Areas {
    const SIZE: (u32, u32) = (1000, 700);

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let most = |value: fn(&crate::paper::areas::Point) -> f64| {
            self.points.iter().map(value).fold(0.0, f64::max).max(1e-9)
        };
        let (right, top) = (1.05 * most(|p| p.area), 1.1 * most(|p| p.hits as f64).max(1.0));
        let mut chart = ChartBuilder::on(area)
            .caption(
                format!("Lines that meet a box, of {}", self.lines),
                letters(TITLE, INK, HPos::Left, VPos::Top),
            )
            .margin(18)
            .x_label_area_size(52)
            .y_label_area_size(84)
            .build_cartesian_2d(0.0..right, 0.0..top)?;
        let text = letters(TEXT, INK, HPos::Left, VPos::Top);
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .bold_line_style(FAINT)
            .axis_style(GREY)
            .label_style(text.clone())
            .x_desc("surface area of the box / that of the sphere around the scene")
            .y_desc("lines that meet the box")
            .y_label_formatter(&|hits| format!("{hits:.0}"))
            .draw()?;
        let ends = [0.0, right].map(|x| (x, self.slope * x + self.intercept));
        chart
            .draw_series(LineSeries::new(ends, INK.stroke_width(2)))?
            .label(format!(
                "{:.0} area {:+.1}, R² = {:.5}",
                self.slope, self.intercept, self.r_squared
            ))
            .legend(|(x, y)| PathElement::new([(x, y), (x + 22, y)], INK.stroke_width(2)));
        for (cell, colour, label) in
            [(true, BLUE, "cells of the tree"), (false, ORANGE, "random boxes")]
        {
            let points = self.points.iter().filter(|point| point.cell == cell);
            let circles = points.map(|point| {
                Circle::new((point.area, point.hits as f64), 5, colour.mix(0.8).filled())
            });
            chart
                .draw_series(circles)?
                .label(label)
                .legend(move |(x, y)| Circle::new((x + 11, y), 5, colour.mix(0.8).filled()));
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
