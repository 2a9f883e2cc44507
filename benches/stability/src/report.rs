//! Rows as they come, totals at the end, JSON.

use crate::options::Options;
use serde_json::json;
use splitplane_test_support::stability::Tally;
use std::error::Error;

/// One set of rays at one mesh.
pub(crate) struct Row {
    /// The mesh.
    pub scene: String,
    /// Its triangles.
    pub triangles: usize,
    /// Where mesh and rays are.
    pub place: &'static str,
    /// How many times its size the mesh was moved.
    pub sizes: f64,
    /// From which side.
    pub from: &'static str,
    /// What rays are aimed at.
    pub aim: &'static str,
    /// Wall time of tracing and judging.
    pub seconds: f64,
    /// What was counted.
    pub tally: Tally,
}

/// Collects rows.
pub(crate) struct Report {
    rows: Vec<Row>,
    exact: bool,
}

impl Report {
    /// Prints the head of the table.
    pub(crate) fn new(options: &Options) -> Report {
        println!(
            "| scene | triangles | place | from | aim | rays | hits | missed | holes | phantoms | \
             other triangle | wrong | ties | inexact | contradictions |"
        );
        println!("|---|--:|---|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|");
        Report { rows: Vec::new(), exact: options.is_exact() }
    }

    /// Prints a row and keeps it.
    pub(crate) fn add(&mut self, row: Row) {
        let place = match row.sizes {
            0.0 => row.place.to_owned(),
            sizes => format!("{} {sizes:.0e}", row.place),
        };
        print_line(&row.scene, row.triangles, &place, row.from, row.aim, &row.tally);
        if let Some(first) = &row.tally.first {
            eprintln!("{}, {place}, {}, {}: {first}", row.scene, row.from, row.aim);
        }
        self.rows.push(row);
    }

    /// Prints totals by place, side and aim; writes JSON. True where nothing is wrong.
    pub(crate) fn finish(self, options: &Options) -> Result<bool, Box<dyn Error + Send + Sync>> {
        let mut sums: Vec<([&str; 3], Tally)> = Vec::new();
        for row in &self.rows {
            let key = [row.place, row.from, row.aim];
            match sums.iter_mut().find(|(known, _)| *known == key) {
                Some((_, sum)) => sum.add(&row.tally),
                None => sums.push((key, row.tally.clone())),
            }
        }
        for ([place, from, aim], sum) in &sums {
            print_line("all", 0, place, from, aim, sum);
        }
        let seconds: f64 = self.rows.iter().map(|row| row.seconds).sum();
        let rays: u64 = self.rows.iter().map(|row| row.tally.rays).sum();
        eprintln!("{rays} rays in {seconds:.1} s");
        if let Some(path) = &options.json {
            let rows: Vec<_> = self.rows.iter().map(json_row).collect();
            let whole = json!({
                "command": std::env::args().skip(1).collect::<Vec<_>>().join(" "),
                "version": env!("CARGO_PKG_VERSION"),
                "rows": rows,
            });
            std::fs::write(path, serde_json::to_string_pretty(&whole)?)?;
        }
        Ok(sums.iter().all(|(_, sum)| {
            let sound = sum.holes + sum.wrong + sum.contradictions == 0;
            sound && (!self.exact || sum.inexact == 0)
        }))
    }
}

fn print_line(scene: &str, triangles: usize, place: &str, from: &str, aim: &str, tally: &Tally) {
    let Tally { rays, hits, missed, holes, phantoms, others, wrong, ties, .. } = tally;
    let (inexact, contradictions) = (tally.inexact, tally.contradictions);
    println!(
        "| {scene} | {triangles} | {place} | {from} | {aim} | {rays} | {hits} | {missed} | {holes} | \
         {phantoms} | {others} | {wrong} | {ties} | {inexact} | {contradictions} |"
    );
}

fn json_row(row: &Row) -> serde_json::Value {
    let tally = &row.tally;
    json!({
        "scene": row.scene,
        "triangles": row.triangles,
        "place": row.place,
        "sizes_from_the_origin": row.sizes,
        "from": row.from,
        "aim": row.aim,
        "seconds": row.seconds,
        "rays": tally.rays,
        "hits": tally.hits,
        "missed": tally.missed,
        "holes": tally.holes,
        "phantoms": tally.phantoms,
        "other_triangle": tally.others,
        "wrong": tally.wrong,
        "ties": tally.ties,
        "inexact": tally.inexact,
        "inexact_triangle": tally.inexact_triangle,
        "contradictions": tally.contradictions,
        "first": tally.first,
    })
}
