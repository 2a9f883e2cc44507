//! Tables 3 and 4 and those of the figures: ours beside the survey's.

use super::areas::Areas;
use super::others::Others;
use super::scaling::Scaling;
use super::scene::{BuilderRow, SceneReport};
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
pub const TABLE_4: [&str; 13] = [
    "picture",
    "scene",
    "triangles",
    "structure",
    "backend",
    "threads",
    "update ms",
    "T_trace ms",
    "frames/s",
    "rays ms",
    "frames/s, rays alone",
    "survey's triangles",
    "survey's frames/s",
];

/// Table 4: frames a second with the structure rebuilt, or refitted, for each.
pub fn table_4(scenes: &[SceneReport], others: Option<&Others>) -> Table {
    let mut table = Table::new(&TABLE_4);
    let rate = |ms: f64| Cell::number((ms > 0.0).then(|| 1e3 / ms), 2);
    for scene in scenes {
        let survey = scene.survey;
        let start = || -> Vec<Cell> {
            let letter = scene.letter.to_string();
            vec![letter.into(), scene.name.as_str().into(), scene.triangles.into()]
        };
        let end = |printed: Option<f64>| {
            let triangles = Cell::from(1000 * survey.kilo_triangles);
            [if printed.is_some() { triangles } else { Cell::Missing }, Cell::number(printed, 2)]
        };
        for row in scene.builders.iter().filter(|row| row.knobs == "tuned") {
            let (structure, printed) = match (row.offline, row.preset, row.backend.as_str()) {
                (true, ..) => ("offline", None),
                (_, "fast", _) => ("Zhou et al. 2008", Some(survey.fps)),
                (_, "balanced", "cpu") => ("Shevtsov et al. 2007", survey.fps_shevtsov),
                _ => ("binned SAH", None),
            };
            let mut cells = start();
            cells.extend([
                format!("kd-tree, {} ({structure})", row.preset).into(),
                row.backend.as_str().into(),
                row.threads.map_or(Cell::Missing, Cell::from),
                Cell::Number(row.tree_ms, 2),
                Cell::Number(row.trace_ms, 2),
                rate(row.tree_ms + row.trace_ms),
                Cell::Number(row.rays_ms, 2),
                rate(row.tree_ms + row.rays_ms),
            ]);
            cells.extend(end(printed));
            table.push(cells);
        }
        if let Some((others, other)) = others.and_then(|all| Some((all, all.of(scene)?))) {
            let mut cells = start();
            cells.extend([
                others.builder.as_str().into(),
                "cpu".into(),
                others.threads.into(),
                Cell::Number(other.update_ms, 2),
                Cell::Missing,
                Cell::Missing,
                Cell::Number(other.rays_ms, 2),
                rate(other.update_ms + other.rays_ms),
            ]);
            cells.extend(end(survey.fps_dbvh));
            table.push(cells);
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
