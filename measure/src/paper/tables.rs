//! Tables 3 and 4 and those of the figures: ours beside the survey's.

use super::areas::Areas;
use super::motion::{Motion, Update};
use super::scaling::Scaling;
use super::scene::{BuilderRow, SceneReport};
use super::survey::nearest;
use super::table::{Cell, Table};

/// Columns of [`table_3`]. Ratios are ours over the offline builder's, but for the speed-up.
pub const TABLE_3: [&str; 25] = [
    "picture",
    "scene",
    "triangles",
    "lights",
    "builder",
    "knobs",
    "backend",
    "threads",
    "T_tree ms",
    "T_trace ms",
    "SAH cost",
    "SAH cost as printed",
    "block cost",
    "build speed-up",
    "SAH ratio",
    "SAH ratio as printed",
    "block cost ratio",
    "T_trace ratio",
    "survey's triangles",
    "survey's T_tree ms",
    "survey's T_trace ms",
    "survey's SAH cost",
    "survey's build speed-up",
    "survey's SAH ratio",
    "survey's T_trace ratio",
];

/// Table 3: time to build, time to trace and SAH cost of every builder.
pub fn table_3(scenes: &[SceneReport]) -> Table {
    let mut table = Table::new(&TABLE_3);
    for scene in scenes {
        for row in &scene.builders {
            table.push(row_of_table_3(scene, row));
        }
    }
    table
}

fn row_of_table_3(scene: &SceneReport, row: &BuilderRow) -> Vec<Cell> {
    let base = scene.offline(row.knobs).filter(|_| !row.offline);
    // What another device traces does not compare trees.
    let traced_alike = base.filter(|base| base.backend == row.backend);
    let survey = scene.survey;
    // The survey has two builders: offline, and the paper's in parallel.
    let column = match (row.offline, row.preset) {
        (true, _) => Some(0),
        (false, "fast") => Some(1),
        _ => None,
    };
    let printed = |values: [f64; 2], decimals| Cell::number(column.map(|i| values[i]), decimals);
    let ratio = |value: f64, decimals| Cell::number((column == Some(1)).then_some(value), decimals);
    vec![
        scene.letter.to_string().into(),
        scene.name.as_str().into(),
        scene.triangles.into(),
        scene.lights.into(),
        row.preset.into(),
        row.knobs.into(),
        row.backend.as_str().into(),
        row.threads.map_or(Cell::Missing, Cell::from),
        Cell::Number(row.tree_ms, 2),
        Cell::Number(row.trace_ms, 2),
        Cell::Number(row.sah_cost, 2),
        Cell::Number(row.printed_cost, 2),
        Cell::Number(row.block_cost, 2),
        Cell::number(base.map(|base| base.tree_ms / row.tree_ms), 2),
        Cell::number(base.map(|base| row.sah_cost / base.sah_cost), 3),
        Cell::number(base.map(|base| row.printed_cost / base.printed_cost), 3),
        Cell::number(base.map(|base| row.block_cost / base.block_cost), 3),
        Cell::number(traced_alike.map(|base| row.trace_ms / base.trace_ms), 3),
        column.map_or(Cell::Missing, |_| Cell::from(1000 * survey.kilo_triangles)),
        printed(survey.tree_s.map(|s| 1e3 * s), 0),
        printed(survey.trace_s.map(|s| 1e3 * s), 0),
        printed(survey.sah, 1),
        ratio(survey.build_speedup(), 1),
        ratio(survey.sah_ratio(), 2),
        ratio(survey.trace_ratio(), 2),
    ]
}

/// Columns of [`table_4`].
pub const TABLE_4: [&str; 17] = [
    "picture",
    "scene",
    "triangles",
    "structure",
    "in each frame",
    "backend",
    "threads",
    "update ms",
    "T_trace ms",
    "frames/s",
    "rays ms",
    "frames/s, rays alone",
    "rays ms, least",
    "rays ms, most",
    "worst over built anew",
    "survey's triangles",
    "survey's frames/s",
];

/// Table 4: frames a second of scenes that move, with the structure built, or refitted, for each frame.
pub fn table_4(motions: &[Motion]) -> Table {
    let mut table = Table::new(&TABLE_4);
    let rate = |ms: f64| Cell::number((ms > 0.0).then(|| 1e3 / ms), 2);
    for motion in motions {
        let survey = nearest(motion.triangles);
        for course in &motion.courses {
            let printed = match (course.preset, course.update, course.backend.as_str()) {
                (Some("fast"), ..) => Some(survey.fps),
                (Some("balanced"), _, "cpu") => survey.fps_shevtsov,
                (None, Update::Refitted, _) => survey.fps_dbvh,
                _ => None,
            };
            let update = course.median(|took| took.update_ms);
            let rays = course.median(|took| took.rays_ms);
            let all = |end: fn(f64, f64) -> f64| {
                course.frames.iter().map(|took| took.rays_ms).reduce(end)
            };
            let traced = course.frames.iter().all(|took| took.trace_ms.is_some());
            let trace = traced.then(|| course.median(|took| took.trace_ms.unwrap_or(0.0)));
            let decays = course.preset.is_none() && course.update == Update::Refitted;
            let worst = motion.decay().filter(|_| decays).map(|[_, worst]| worst);
            table.push(vec![
                motion.letter.to_string().into(),
                motion.scene.as_str().into(),
                motion.triangles.into(),
                course.structure.as_str().into(),
                match course.update {
                    Update::Built => "built",
                    Update::Refitted => "refitted",
                }
                .into(),
                course.backend.as_str().into(),
                course.threads.map_or(Cell::Missing, Cell::from),
                Cell::Number(update, 2),
                Cell::number(trace, 2),
                trace.map_or(Cell::Missing, |trace| rate(update + trace)),
                Cell::Number(rays, 2),
                rate(update + rays),
                Cell::number(all(f64::min), 2),
                Cell::number(all(f64::max), 2),
                Cell::number(worst, 2),
                match printed {
                    Some(_) => (1000 * survey.kilo_triangles).into(),
                    None => Cell::Missing,
                },
                Cell::number(printed, 2),
            ]);
        }
    }
    table
}

/// The points of Figure 7.
pub fn figure_7(areas: &Areas) -> Table {
    let mut table = Table::new(&["box", "area", "lines that meet it", "fitted", "expected"]);
    for point in &areas.points {
        table.push(vec![
            if point.cell { "cell" } else { "random" }.into(),
            Cell::Number(point.area, 4),
            Cell::Count(point.hits),
            Cell::Number(areas.slope * point.area + areas.intercept, 1),
            Cell::Number(areas.expected_slope() * point.area, 1),
        ]);
    }
    table
}

/// The points of Figure 12.
pub fn figure_12(scalings: &[Scaling]) -> Table {
    let mut table = Table::new(&[
        "scene",
        "triangles",
        "backend",
        "processors",
        "T_tree ms",
        "speed-up",
        "survey's greatest speed-up",
    ]);
    for scaling in scalings {
        for point in &scaling.points {
            table.push(vec![
                scaling.scene.as_str().into(),
                scaling.triangles.into(),
                scaling.backend.into(),
                point.processors.into(),
                Cell::Number(point.tree_ms, 2),
                Cell::Number(point.speedup, 2),
                Cell::Number(scaling.survey_speedup, 0),
            ]);
        }
    }
    table
}
