//! Boxes and lines in space.

use super::map::Map;
use super::style::{GREY, INK, TEXT, bold, letters};
use super::{Area, Drawn, Plot};
use crate::paper::space::{HIDDEN_EDGES, Paint, Panel, SEEN_FACES, Space, corners, isometric};
use plotters::prelude::{DrawingBackend, RGBColor, Text};
use plotters::style::Color;
use plotters::style::text_anchor::{HPos, VPos};

/// How bright the faces are that look along x, y and z: light comes from above.
const LIGHT: [f64; 3] = [0.82, 1.0, 0.66];

fn colour(paint: Paint) -> RGBColor {
    match paint {
        Paint::Red => RGBColor(196, 64, 56),
        Paint::Blue => RGBColor(58, 118, 190),
        Paint::Yellow => RGBColor(236, 190, 60),
        Paint::Green => RGBColor(84, 158, 104),
        Paint::Orange => RGBColor(214, 104, 20),
        Paint::Grey => GREY,
    }
}

fn lit(RGBColor(r, g, b): RGBColor, light: f64) -> RGBColor {
    let channel = |x: u8| (f64::from(x) * light).round() as u8;
    RGBColor(channel(r), channel(g), channel(b))
}

impl Plot for Space {
    const SIZE: (u32, u32) = (1300, 760);

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let wide = 1220.0 / self.panels.len().max(1) as f64;
        for (place, panel) in self.panels.iter().enumerate() {
            let left = 40.0 + wide * place as f64;
            let title = bold(20, INK, HPos::Left, VPos::Top);
            area.draw(&Text::new(panel.title.clone(), (left as i32, 26), title))?;
            draw(panel, area, [left + 10.0, 70.0, left + wide - 30.0, 700.0])?;
        }
        let style = letters(TEXT, INK, HPos::Left, VPos::Top);
        area.draw(&Text::new(self.note.clone(), (40, 724), style))?;
        Ok(())
    }
}

fn draw<B: DrawingBackend>(panel: &Panel, area: &Area<B>, pixels: [f64; 4]) -> Drawn
where
    B::ErrorType: 'static,
{
    let boxes = panel.solids.iter().flat_map(|solid| corners(&solid.bounds));
    let points = boxes.chain(panel.paths.iter().flat_map(|path| path.points.iter().copied()));
    let (mut lower, mut upper) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for point in points.map(isometric) {
        for axis in 0..2 {
            lower[axis] = lower[axis].min(point[axis]);
            upper[axis] = upper[axis].max(point[axis]);
        }
    }
    if lower[0] > upper[0] {
        return Ok(());
    }
    let map = Map::new(lower, upper, pixels);
    for solid in &panel.solids {
        let at = corners(&solid.bounds).map(isometric);
        let own = colour(solid.paint);
        for [a, b] in HIDDEN_EDGES {
            map.line(area, &[at[a], at[b]], own.mix(0.35).stroke_width(1))?;
        }
        for (face, light) in SEEN_FACES.into_iter().zip(LIGHT) {
            let face = face.map(|corner| at[corner]);
            if solid.opacity > 0.0 {
                map.polygon(area, &face, lit(own, light).mix(solid.opacity).filled())?;
            }
            let edge = if solid.opacity > 0.0 { INK.mix(0.7) } else { own.mix(0.7) };
            map.line(area, &[&face[..], &face[..1]].concat(), edge.stroke_width(1))?;
        }
    }
    for path in &panel.paths {
        let points: Vec<[f64; 2]> = path.points.iter().map(|point| isometric(*point)).collect();
        let style = colour(path.paint).stroke_width(if path.paint == Paint::Grey { 1 } else { 2 });
        if path.dashed {
            for pair in points.windows(2) {
                map.dashes(area, [pair[0], pair[1]], style)?;
            }
        } else {
            map.line(area, &points, style)?;
        }
    }
    for label in &panel.labels {
        let style = bold(16, INK, HPos::Center, VPos::Center);
        area.draw(&Text::new(label.words.clone(), map.pixel(isometric(label.at)), style))?;
    }
    Ok(())
}
