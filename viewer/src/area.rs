//! The part of the window that shows the picture: what the mouse and the keys do there, and what is
//! drawn over it.

use super::boxes::{self, Content, EDGES, LevelBoxes};
use super::projection::Projection;
use super::rig::Mode;
use super::source::DebugView;
use super::state::{Scene, State};
use egui::{Align2, Color32, CornerRadius, FontId, Key, PointerButton, Rect, Sense, Stroke, Vec2};

/// Pixels of the wheel that are one step.
const WHEEL: f64 = 40.0;
/// The keys and what they do, for the list of them.
pub(super) const KEYS: [(&str, &str); 13] = [
    ("left drag", "turn"),
    ("right or middle drag", "pan"),
    ("wheel", "zoom; flying speed"),
    ("F", "orbit or fly"),
    ("W A S D", "fly ahead, left, back, right"),
    ("E Q", "fly up, down"),
    ("Shift", "fly faster"),
    ("R", "reset the camera"),
    ("1 2 3 …", "views"),
    ("B", "boxes of the tree"),
    ("PgUp PgDn", "boxes one level up, down"),
    ("H", "hide or show the panel"),
    ("F1", "this list"),
];

/// Shows the area and gives its place, in points.
pub(super) fn show(ui: &mut egui::Ui, state: &mut State) -> Rect {
    let rect = ui.available_rect_before_wrap();
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    let height = f64::from(rect.height()).max(1.0);
    if let Some(scene) = &mut state.scene {
        let before = scene.rig.camera();
        let drag = response.drag_delta();
        let [right, down] = [drag.x, drag.y].map(|part| f64::from(part) / height);
        if response.dragged_by(PointerButton::Primary) {
            scene.rig.turn(right, down);
        } else if response.dragged_by(PointerButton::Secondary)
            || response.dragged_by(PointerButton::Middle)
        {
            scene.rig.pan(right, down);
        }
        if response.hovered() {
            let wheel = ui.input(|input| input.smooth_scroll_delta().y);
            scene.rig.zoom(f64::from(wheel) / WHEEL);
        }
        if scene.rig.mode == Mode::Fly && !ui.ctx().egui_wants_keyboard_input() {
            fly(ui, scene);
        }
        if scene.rig.camera() != before {
            state.touch();
        }
    }
    overlay(ui, rect, state);
    rect
}

/// Moves the camera by the keys that are held.
fn fly(ui: &egui::Ui, scene: &mut Scene) {
    let (direction, seconds, fast) = ui.input(|input| {
        let axis = |ahead: Key, back: Key| {
            f64::from(u8::from(input.key_down(ahead))) - f64::from(u8::from(input.key_down(back)))
        };
        let plain = !input.modifiers.command && !input.modifiers.alt;
        let direction = [axis(Key::D, Key::A), axis(Key::E, Key::Q), axis(Key::W, Key::S)];
        let direction = if plain { direction } else { [0.0; 3] };
        (direction, f64::from(input.stable_dt.min(0.1)), input.modifiers.shift)
    });
    if direction != [0.0; 3] {
        scene.rig.fly(direction, seconds, fast);
        ui.ctx().request_repaint();
    }
}

/// Keys that act once, wherever the pointer is.
pub(super) fn keys(ui: &egui::Ui, state: &mut State) {
    if ui.ctx().egui_wants_keyboard_input() {
        return;
    }
    let pressed = |key: Key| {
        ui.input(|input| input.key_pressed(key) && !input.modifiers.command && !input.modifiers.alt)
    };
    if pressed(Key::F1) {
        state.shows_keys = !state.shows_keys;
    }
    if pressed(Key::Escape) {
        state.shows_keys = false;
    }
    if pressed(Key::H) {
        state.shows_panel = !state.shows_panel;
    }
    if pressed(Key::B) {
        state.choices.boxes = !state.choices.boxes;
    }
    let deepest = state.frame.as_ref().and_then(|frame| frame.report.tree.shape);
    let deepest = deepest.map_or(state.choices.level, |shape| shape.max_depth);
    if pressed(Key::PageUp) {
        state.choices.level = state.choices.level.saturating_sub(1);
    }
    if pressed(Key::PageDown) {
        state.choices.level = (state.choices.level + 1).min(deepest);
    }
    let Some(scene) = &mut state.scene else { return };
    if pressed(Key::F) {
        scene.rig.mode = match scene.rig.mode {
            Mode::Orbit => Mode::Fly,
            Mode::Fly => Mode::Orbit,
        };
    }
    if pressed(Key::R) {
        scene.rig.reset();
    }
    if pressed(Key::Space) && scene.opening.abilities.seconds.is_some() {
        state.playing = !state.playing;
    }
    let numbers = [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6];
    for (key, &view) in numbers.into_iter().zip(&scene.opening.abilities.views) {
        if pressed(key) {
            state.choices.view = view;
        }
    }
}

fn overlay(ui: &egui::Ui, rect: Rect, state: &State) {
    let painter = ui.painter_at(rect);
    let Some(scene) = &state.scene else {
        let text = "Building the tree…";
        let grey = Color32::from_gray(190);
        painter.text(rect.center(), Align2::CENTER_CENTER, text, FontId::proportional(16.0), grey);
        return;
    };
    let Some(frame) = &state.frame else { return };
    if state.choices.boxes
        && let Some(boxes) = &frame.boxes
    {
        // Through the camera of the picture, which may be a little behind the hand.
        let near = scene.rig.distance() * 1e-4;
        let aspect = f64::from(rect.width()) / f64::from(rect.height().max(1.0));
        let projection = Projection::new(&frame.job.request.camera, aspect, near);
        draw_boxes(&painter, rect, &projection, boxes);
    }
    let view = frame.job.request.view;
    let mut text = view.title().to_owned();
    if let Some(legend) = &frame.report.legend {
        text.push_str(&format!(": {legend}"));
    }
    if view != DebugView::Shaded {
        caption(&painter, rect, &text);
    }
}

/// A line of text on a dark ground in the upper left corner.
fn caption(painter: &egui::Painter, rect: Rect, text: &str) {
    let galley =
        painter.layout_no_wrap(text.to_owned(), FontId::proportional(13.0), Color32::WHITE);
    let at = rect.left_top() + Vec2::splat(10.0);
    let ground = Rect::from_min_size(at, galley.size() + Vec2::new(16.0, 8.0));
    painter.rect_filled(ground, CornerRadius::same(4), Color32::from_black_alpha(170));
    painter.galley(at + Vec2::new(8.0, 4.0), galley, Color32::WHITE);
}

fn draw_boxes(painter: &egui::Painter, rect: Rect, projection: &Projection, boxes: &LevelBoxes) {
    // Many boxes are thin lines, few are clear ones.
    let width = if boxes.boxes.len() > 200 { 0.7 } else { 1.2 };
    let place = |[x, y]: [f64; 2]| rect.lerp_inside(Vec2::new(x as f32, y as f32));
    let mut lines = Vec::new();
    for (cell, content) in &boxes.boxes {
        let colour = colour_of(*content);
        let corners = boxes::corners(cell);
        for [a, b] in EDGES {
            if let Some(line) = projection.line(corners[a], corners[b]) {
                let points = line.map(place);
                lines.push(egui::Shape::line_segment(points, Stroke::new(width, colour)));
            }
        }
    }
    painter.extend(lines);
}

/// The colour of the boxes with this content.
pub(super) fn colour_of(content: Content) -> Color32 {
    match content {
        Content::Interior => Color32::from_rgba_unmultiplied(255, 176, 46, 170),
        Content::Leaf => Color32::from_rgba_unmultiplied(80, 220, 130, 190),
        Content::Empty => Color32::from_rgba_unmultiplied(140, 160, 190, 90),
    }
}
