//! The panel: choices above, figures below.

use super::area::{KEYS, colour_of};
use super::boxes::{Content, MOST};
use super::rig::Mode;
use super::source::FrameReport;
use super::state::State;
use egui::{Color32, Grid, RichText, ScrollArea, Slider, Ui};
use splitplane::backend::BackendKind;

/// The panel's width in points.
pub(super) const WIDTH: f32 = 292.0;

/// Shows the panel's contents.
pub(super) fn show(ui: &mut Ui, state: &mut State) {
    let before = state.choices;
    ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        ui.spacing_mut().item_spacing.y = 5.0;
        title(ui, state);
        camera(ui, state);
        view(ui, state);
        boxes(ui, state);
        rendering(ui, state);
        animation(ui, state);
        figures(ui, state);
    });
    if state.choices != before {
        state.error = None;
    }
}

/// How the window looks: dark around the picture, with text that stays legible.
pub(super) fn style(context: &egui::Context) {
    context.set_theme(egui::Theme::Dark);
    context.all_styles_mut(|style| {
        style.visuals.panel_fill = Color32::from_rgb(24, 26, 30);
        style.visuals.window_fill = Color32::from_rgb(30, 32, 37);
        style.visuals.override_text_color = Some(Color32::from_gray(222));
        style.visuals.weak_text_color = Some(Color32::from_gray(150));
        // With room of its own, so that it covers no figures.
        style.spacing.scroll = egui::style::ScrollStyle::thin();
        // What cannot be edited is not to be selected either: drags are for the camera.
        style.interaction.selectable_labels = false;
    });
}

/// The list of keys, in a window of its own.
pub(super) fn keys(ctx: &egui::Context, state: &mut State) {
    egui::Window::new("Keys")
        .open(&mut state.shows_keys)
        .collapsible(false)
        .resizable(false)
        .default_pos([24.0, 52.0])
        .show(ctx, |ui| {
            Grid::new("keys").num_columns(2).spacing([18.0, 4.0]).show(ui, |ui| {
                for (key, what) in KEYS {
                    ui.label(RichText::new(key).strong());
                    ui.label(what);
                    ui.end_row();
                }
            });
        });
}

fn heading(ui: &mut Ui, text: &str) {
    ui.add_space(5.0);
    ui.separator();
    ui.label(RichText::new(text).strong().size(13.5));
}

fn title(ui: &mut Ui, state: &mut State) {
    ui.horizontal(|ui| {
        let name = state.scene.as_ref().map_or("splitplane", |scene| &scene.opening.scene);
        ui.add(egui::Label::new(RichText::new(name).strong().size(16.0)).truncate());
        if state.waits() && state.error.is_none() {
            ui.label(RichText::new("working").weak());
        }
    });
    if let Some(error) = &state.error {
        ui.label(RichText::new(error).color(Color32::from_rgb(255, 120, 100)));
    }
}

fn camera(ui: &mut Ui, state: &mut State) {
    heading(ui, "Camera");
    let mut keys = state.shows_keys;
    if let Some(scene) = &mut state.scene {
        ui.horizontal(|ui| {
            ui.selectable_value(&mut scene.rig.mode, Mode::Orbit, "Orbit");
            ui.selectable_value(&mut scene.rig.mode, Mode::Fly, "Fly");
            if ui.button("Reset").clicked() {
                scene.rig.reset();
            }
            ui.toggle_value(&mut keys, "Keys (F1)");
        });
        let [x, y, z] = scene.rig.camera().eye();
        let eye = format!("at {x:.4}, {y:.4}, {z:.4}");
        ui.add(egui::Label::new(RichText::new(eye).weak().monospace().size(11.0)).truncate());
    }
    state.shows_keys = keys;
}

fn view(ui: &mut Ui, state: &mut State) {
    let Some(scene) = &state.scene else { return };
    heading(ui, "View");
    ui.horizontal_wrapped(|ui| {
        for (index, &view) in scene.opening.abilities.views.iter().enumerate() {
            let label = ui.selectable_value(&mut state.choices.view, view, view.title());
            label.on_hover_text(format!("key {}", index + 1));
        }
    });
}

fn boxes(ui: &mut Ui, state: &mut State) {
    let Some(frame) = &state.frame else { return };
    heading(ui, "Boxes of the tree");
    let deepest = frame.report.tree.shape.map(|shape| shape.max_depth);
    ui.horizontal(|ui| {
        ui.checkbox(&mut state.choices.boxes, "show");
        match deepest {
            Some(0) => drop(ui.label(RichText::new("the root is a leaf").weak())),
            Some(deepest) => {
                ui.add(Slider::new(&mut state.choices.level, 0..=deepest).text("depth"));
            }
            None => {}
        }
    });
    if !state.choices.boxes {
        return;
    }
    if let Some(boxes) = &frame.boxes {
        let text = match boxes.total {
            1 => "1 box:".to_owned(),
            total if total > MOST => format!("the {MOST} largest of {}:", grouped(total as u64)),
            total => format!("{total} boxes:"),
        };
        ui.horizontal(|ui| {
            ui.label(RichText::new(text).weak());
            let parts = [
                ("nodes", Content::Interior),
                ("leaves", Content::Leaf),
                ("empty", Content::Empty),
            ];
            for (name, content) in parts {
                ui.label(RichText::new(name).color(colour_of(content).to_opaque()));
            }
        });
    }
}

fn rendering(ui: &mut Ui, state: &mut State) {
    let Some(scene) = &state.scene else { return };
    let can = &scene.opening.abilities;
    let choices = &mut state.choices;
    heading(ui, "Rendering");
    Grid::new("rendering").num_columns(2).spacing([12.0, 5.0]).show(ui, |ui| {
        ui.label("backend");
        ui.horizontal(|ui| {
            for &backend in &can.backends {
                ui.selectable_value(&mut choices.backend, backend, backend.name());
            }
            if choices.backend == scene.opening.backend {
                let reason = RichText::new(&scene.opening.reason).weak().size(11.0);
                ui.add(egui::Label::new(reason).truncate());
            }
        });
        ui.end_row();
        ui.label("preset");
        ui.horizontal(|ui| {
            for &preset in &can.presets {
                let possible = choices.backend == BackendKind::Cpu || preset.planes().is_some();
                ui.add_enabled_ui(possible, |ui| {
                    ui.selectable_value(&mut choices.preset, preset, preset.name());
                });
            }
        });
        ui.end_row();
        ui.label("accuracy");
        ui.horizontal(|ui| {
            for &accuracy in &can.accuracies {
                ui.selectable_value(&mut choices.accuracy, accuracy, accuracy.name());
            }
        });
        ui.end_row();
        if can.max_depth > 0 {
            ui.label("depth");
            ui.add(Slider::new(&mut choices.depth, 0..=can.max_depth));
            ui.end_row();
        }
        if can.max_samples > 1 {
            ui.label("samples");
            ui.add(Slider::new(&mut choices.samples, 1..=can.max_samples).logarithmic(true));
            ui.end_row();
        }
    });
}

fn animation(ui: &mut Ui, state: &mut State) {
    let Some(seconds) = state.scene.as_ref().and_then(|scene| scene.opening.abilities.seconds)
    else {
        return;
    };
    heading(ui, "Animation");
    ui.horizontal(|ui| {
        ui.toggle_value(&mut state.playing, "Play");
        ui.add(Slider::new(&mut state.time, 0.0..=seconds).suffix(" s"));
    });
}

fn figures(ui: &mut Ui, state: &State) {
    let Some(frame) = &state.frame else { return };
    let report = &frame.report;
    heading(ui, "Frame");
    let request = frame.job.request;
    figures_grid(ui, "frame", |ui| {
        row(ui, "by", report.backend.clone());
        let coarse = if frame.job.step > 1 { " (moving)" } else { "" };
        row(ui, "picture", format!("{} x {}{coarse}", request.width, request.height));
        row(ui, "trace, shade", format!("{:.1} ms", report.trace_ms));
        if report.update_ms > 0.0 {
            row(ui, "update", format!("{:.1} ms", report.update_ms));
        }
        row(ui, "whole frame", format!("{:.1} ms", report.total_ms));
        row(ui, "rays", format!("{} ({})", grouped(report.rays), rate(report)));
        if let Some(build_ms) = state.build_ms {
            row(ui, "last build", format!("{build_ms:.1} ms"));
        }
    });
    heading(ui, "Tree");
    let tree = &report.tree;
    figures_grid(ui, "tree", |ui| {
        row(ui, "triangles", grouped(u64::from(report.triangles)));
        row(ui, "nodes", grouped(tree.nodes as u64));
        row(ui, "references", grouped(tree.references as u64));
        row(ui, "memory", bytes(tree.bytes));
        // Not while a device keeps the tree to itself.
        if let Some(shape) = &tree.shape {
            let [leaves, empty] =
                [shape.leaves, shape.empty_leaves].map(|count| grouped(count as u64));
            row(ui, "leaves", format!("{leaves} ({empty} empty)"));
            row(ui, "depth", shape.max_depth.to_string());
            row(ui, "SAH cost", format!("{:.2}", shape.sah_cost));
        }
    });
}

fn figures_grid(ui: &mut Ui, name: &str, rows: impl FnOnce(&mut Ui)) {
    ui.scope(|ui| {
        // Text only: rows need not be as high as buttons.
        ui.spacing_mut().interact_size.y = 15.0;
        let grid = Grid::new(name).num_columns(2).spacing([10.0, 2.0]).min_col_width(76.0);
        grid.show(ui, rows);
    });
}

/// A figure: its name on the left, its value on the right.
fn row(ui: &mut Ui, what: &str, value: String) {
    ui.label(RichText::new(what).weak());
    ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
        ui.add(egui::Label::new(RichText::new(value).monospace().size(12.0)).truncate());
    });
    ui.end_row();
}

/// Millions of rays a second.
fn rate(report: &FrameReport) -> String {
    format!("{:.1} M/s", report.rays as f64 / report.trace_ms.max(1e-6) / 1e3)
}

/// Digits in groups of three.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

fn bytes(bytes: u64) -> String {
    match bytes {
        0..1024 => format!("{bytes} B"),
        1024..1_048_576 => format!("{:.1} KiB", bytes as f64 / 1024.0),
        _ => format!("{:.1} MiB", bytes as f64 / 1_048_576.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped() {
        let cases = [(0, "0"), (999, "999"), (1000, "1,000"), (1_234_567, "1,234,567")];
        for (number, text) in cases {
            assert_eq!(grouped(number), text);
        }
        assert_eq!(bytes(1536), "1.5 KiB");
    }
}
