//! The command line: one module a verb. This is the inside of the program `splitplane`, not an interface.

#![forbid(unsafe_code)]
#![doc(hidden)]

mod adapters;
mod animate;
mod bug;
mod build;
pub mod cloud;
mod convert;
mod distances;
mod ending;
pub mod failure;
mod files;
mod hit_file;
mod knobs;
mod look;
mod made;
pub mod merge;
mod mesa;
#[cfg(not(all(feature = "measure", feature = "viewer")))]
mod missing;
pub mod npy;
mod objects;
mod objects_built;
mod objects_report;
mod options;
mod output;
mod own_files;
#[cfg(feature = "measure")]
mod paper;
mod parity;
mod part_file;
mod part_settings;
mod percentiles;
mod points;
mod prepared;
mod probe;
mod progress;
mod query;
mod query_asked;
mod query_given;
mod query_objects;
pub mod ray_file;
mod render;
mod shell;
mod stage;
mod stats;
mod table;
#[cfg(feature = "measure")]
mod trade;
mod tree;
mod verify;
mod verify_objects;
#[cfg(feature = "viewer")]
mod view;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// SAH kd-trees for ray tracing: pictures, trees, ray queries and checks.
///
/// Without a verb, renders. SCENE is the path of an .obj, .ply, .stl, .gltf or .glb file, of a .json or .scene file of many objects, or
/// builtin:NAME[:SIZE].
#[derive(Parser)]
#[command(name = "splitplane", version, args_conflicts_with_subcommands = true)]
#[command(after_help = EXIT_CODES)]
pub struct Cli {
    #[command(subcommand)]
    verb: Option<Verb>,
    #[command(flatten)]
    render: render::Arguments,
}

#[derive(Subcommand)]
enum Verb {
    /// Render a picture of a scene (the default verb).
    Render(render::Arguments),
    /// Render a scene that moves, its tree rebuilt for every frame.
    Animate(animate::Arguments),
    /// Make a picture of the parts that `render --part` wrote.
    Merge(merge::Arguments),
    /// Build a tree and report what it is like.
    Build(build::Arguments),
    /// Build a tree and say all about it: memory, leaves, what rays are expected to cost and do.
    Stats(stats::Arguments),
    /// Trace the rays of a file.
    Query(query::Arguments),
    /// Measure distances to a scene on a grid, signed or not.
    Distances(distances::Arguments),
    /// Build a tree over a cloud of points: its statistics, nearest points, normals, outliers, a thinner cloud, a picture.
    Points(points::Arguments),
    /// Check a tree and its answers against a reference in f64.
    Verify(verify::Arguments),
    /// List the GPU adapters of this machine: limits, features, parity with the CPU.
    Adapters(adapters::Arguments),
    /// Build a scene on CPU and GPU in lockstep and name the first value that differs.
    Parity(parity::Arguments),
    /// Measure what the paper and its survey report, on scenes, and draw their figures.
    #[cfg(feature = "measure")]
    Paper(paper::Arguments),
    /// Measure what each setting costs on a scene and what it gets wrong, and recommend one.
    #[cfg(feature = "measure")]
    Trade(trade::Arguments),
    /// Write a scene as .ply or .glb.
    Convert(convert::Arguments),
    /// Look at a scene in a window: orbit, fly, debug views, boxes of the tree.
    #[cfg(feature = "viewer")]
    View(view::Arguments),
    /// Print the completions of a shell.
    Completions(shell::Completions),
    /// Write manual pages, one for the program and one for each verb.
    Man(shell::ManPages),
    #[command(name = probe::VERB, hide = true)]
    Probe(probe::Arguments),
    /// A verb of a build with more features.
    #[cfg(not(all(feature = "measure", feature = "viewer")))]
    #[command(flatten)]
    Missing(missing::Verb),
}

impl Cli {
    /// Whether the options of a build fit together: what is wrong with them is said before any work.
    ///
    /// # Errors
    /// Wrong usage.
    pub fn check(&self) -> Result<(), failure::Failure> {
        probe::check()?;
        let common = match &self.verb {
            None => &self.render.common,
            Some(Verb::Render(arguments)) => &arguments.common,
            Some(Verb::Animate(arguments)) => &arguments.common,
            Some(Verb::Build(arguments)) => &arguments.common,
            Some(Verb::Stats(arguments)) => &arguments.common,
            Some(Verb::Query(arguments)) => &arguments.common,
            Some(Verb::Distances(arguments)) => &arguments.common,
            Some(Verb::Verify(arguments)) => &arguments.common,
            Some(Verb::Parity(arguments)) => &arguments.common,
            Some(
                Verb::Adapters(_)
                | Verb::Convert(_)
                | Verb::Merge(_)
                | Verb::Points(_)
                | Verb::Completions(_)
                | Verb::Man(_)
                | Verb::Probe(_),
            ) => return Ok(()),
            #[cfg(feature = "measure")]
            Some(Verb::Paper(_) | Verb::Trade(_)) => return Ok(()),
            #[cfg(not(all(feature = "measure", feature = "viewer")))]
            Some(Verb::Missing(_)) => return Ok(()),
            #[cfg(feature = "viewer")]
            Some(Verb::View(arguments)) => &arguments.common,
        };
        common.check()
    }
}

const EXIT_CODES: &str = "\
Built-in scenes: builtin:cornell, builtin:spheres, builtin:stadium, builtin:gallery,
builtin:carousel[:TRIANGLES], builtin:city[:TRIANGLES]; and of many objects
builtin:forest[:OBJECTS], builtin:flock[:BIRDS]

Scenes of many objects (these, .json files, and .scene files that build writes) are for render,
animate, view, build, query and verify; other verbs take one mesh.

Exit codes: 0 done; 1 a check failed; 2 wrong usage; 3 a file cannot be read or written; 4 a limit \
of memory or size binds; 5 a GPU was asked for and there is none that can be used; 6 the device \
failed, was lost or took too long; 7 cancelled, or ended by --timeout, SIGTERM or SIGHUP; 70 a bug \
in splitplane.

A file is written as a whole or not at all, under another name until it is whole. Of one that is \
replaced permissions stay; a symbolic link stays, and what it leads to is replaced; hard links keep \
the old contents.";

/// Runs the program and gives its exit code.
pub fn main() -> ExitCode {
    mesa::silence();
    bug::install();
    ending::install();
    // Wrong usage ends here, with a message and exit code 2.
    let cli = Cli::parse();
    let done = cli.check().and_then(|()| match cli.verb {
        None => render::run(&cli.render),
        Some(Verb::Render(arguments)) => render::run(&arguments),
        Some(Verb::Animate(arguments)) => animate::run(&arguments),
        Some(Verb::Merge(arguments)) => merge::run(&arguments),
        Some(Verb::Build(arguments)) => build::run(&arguments),
        Some(Verb::Stats(arguments)) => stats::run(&arguments),
        Some(Verb::Query(arguments)) => query::run(&arguments),
        Some(Verb::Distances(arguments)) => distances::run(&arguments),
        Some(Verb::Points(arguments)) => points::run(&arguments),
        Some(Verb::Verify(arguments)) => verify::run(&arguments),
        Some(Verb::Adapters(arguments)) => adapters::run(&arguments),
        Some(Verb::Parity(arguments)) => parity::run(&arguments),
        Some(Verb::Convert(arguments)) => convert::run(&arguments),
        #[cfg(feature = "measure")]
        Some(Verb::Paper(arguments)) => paper::run(&arguments),
        #[cfg(feature = "measure")]
        Some(Verb::Trade(arguments)) => trade::run(&arguments),
        #[cfg(feature = "viewer")]
        Some(Verb::View(arguments)) => view::run(&arguments),
        Some(Verb::Completions(arguments)) => shell::completions(&arguments),
        Some(Verb::Man(arguments)) => shell::man_pages(&arguments),
        Some(Verb::Probe(arguments)) => probe::run(&arguments),
        #[cfg(not(all(feature = "measure", feature = "viewer")))]
        Some(Verb::Missing(verb)) => verb.run(),
    });
    match done {
        Ok(()) => {
            ending::succeeded();
            ExitCode::SUCCESS
        }
        Err(failure) => match ending::last_word(failure) {
            Some(failure) => {
                output::report(&failure);
                failure.code()
            }
            None => ending::wait(),
        },
    }
}
