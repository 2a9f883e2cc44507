//! `splitplane merge`: a picture of its parts.

use super::ending::TimeLimit;
use super::failure::Failure;
use super::made::{Made, Wanted};
use super::options::bytes;
use super::part_file::{self, PartFile, PartFileError};
use super::prepared::{counted, print_json};
use super::{ending, output, own_files};
use clap::Args;
use serde::Serialize;
use splitplane::picture::{FirstCost, FirstHit};
use splitplane::render::{Part, Size};
use splitplane_scene::from_file::{self, ReadError, quoted_path};
use std::path::{Path, PathBuf};

/// Most parts of which a message says by number that they are missing.
const SHOWN: usize = 12;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// The parts that `render --part` wrote, all of one picture, in any order
    #[arg(value_name = "PART.picpart", required = true)]
    parts: Vec<PathBuf>,
    /// The picture: .png for screens, or .exr for linear light; the bytes are those that `render` writes
    #[arg(long, short, value_name = "FILE.png|.exr")]
    output: PathBuf,
    /// Most bytes of all parts together. Half of the machine's memory when left out
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    max_file: Option<u64>,
    #[command(flatten)]
    time: TimeLimit,
    /// Report as one JSON object
    #[arg(long)]
    json: bool,
    /// Print nothing but errors and what --json asks for
    #[arg(long, short)]
    quiet: bool,
}

/// What `--json` says.
#[derive(Serialize)]
struct Report {
    parts: usize,
    width: u32,
    height: u32,
    output: Vec<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.time.begin();
    own_files::check(arguments.parts.iter().map(PathBuf::as_path), [arguments.output.as_path()])?;
    let mut parts = Vec::new();
    let most = arguments.max_file.unwrap_or_else(from_file::usual_limit);
    let mut left = most;
    for path in &arguments.parts {
        ending::check()?;
        let bytes = read_within(path, left, arguments.max_file).map_err(|error| {
            let mut message = said(path, &error);
            if let ReadError::TooLong { .. } = error {
                if left < most {
                    message += &format!(", which is what is left of {most} for all parts");
                }
                message += "; --max-file allows more";
            }
            if error.is_limit() { Failure::limit(message) } else { Failure::file(message) }
        })?;
        left = left.saturating_sub(bytes.len() as u64);
        parts.push((path.as_path(), read(path, &bytes)?));
    }
    let count = parts.len();
    let whole = Whole::of(parts)?;
    whole.wanted.check_ending(&arguments.output)?;
    let size = whole.size;
    let made = Made {
        size,
        hits: &whole.hits,
        costs: &whole.costs,
        radiance: &whole.radiance,
        pixels: &whole.pixels,
    };
    let written = whole.wanted.write(&arguments.output, &made)?;
    let (width, height) = (size.width(), size.height());
    let output = written.names();
    if arguments.json {
        return print_json(&Report { parts: count, width, height, output });
    }
    if arguments.quiet {
        return Ok(());
    }
    output::data(&format!(
        "merged   {}\n{}written  {} ({width}x{height})\n",
        counted(count as u64, "part"),
        written.heat.as_deref().unwrap_or(""),
        output.join(", ")
    ))
}

/// The bytes of a part. What may never end has a limit of its own where the user gives none.
fn read_within(path: &Path, left: u64, asked: Option<u64>) -> Result<Vec<u8>, ReadError> {
    let is_stream = asked.is_none() && !path.metadata().is_ok_and(|about| about.is_file());
    from_file::read_any(path, if is_stream { None } else { Some(left) })
}

fn said(path: &Path, error: &dyn std::fmt::Display) -> String {
    format!("cannot read the part in `{}`: {error}", quoted_path(path))
}

/// A part out of the bytes of its file.
fn read(path: &Path, bytes: &[u8]) -> Result<PartFile, Failure> {
    part_file::parse(bytes).map_err(|error| match error {
        PartFileError::Memory => Failure::limit(said(path, &error)),
        error => Failure::file(said(path, &error)),
    })
}

/// What a picture of parts is made of.
#[derive(Debug)]
struct Whole {
    size: Size,
    wanted: Wanted,
    radiance: Vec<[f32; 4]>,
    pixels: Vec<u32>,
    hits: Vec<FirstHit>,
    costs: Vec<FirstCost>,
}

impl Whole {
    /// Puts parts together.
    ///
    /// # Errors
    /// Parts of several pictures, parts that are there twice, parts that are not there; no memory.
    fn of(mut parts: Vec<(&Path, PartFile)>) -> Result<Whole, Failure> {
        let Some((first_path, first)) = parts.first() else {
            return Err(Failure::usage("there are no parts to merge"));
        };
        for (path, part) in &parts[1..] {
            if let Some([name, here, there]) = first.difference(part) {
                let [first, other] = [first_path, path].map(quoted_path);
                return Err(Failure::file(format!(
                    "`{other}` is of another picture than `{first}`: `{name}` is {there}, not {here}"
                )));
            }
        }
        let (size, wanted, count) = (first.size, first.wanted.clone(), first.part.count());
        // Sorted with the order of the arguments kept among equals.
        parts.sort_by_key(|(_, part)| part.part.index());
        for pair in parts.windows(2) {
            let [(first, own), (second, other)] = pair else { continue };
            if own.part == other.part {
                let [first, second] = [first, second].map(quoted_path);
                return Err(Failure::file(format!(
                    "part {} is there twice, in `{first}` and in `{second}`",
                    own.part
                )));
            }
        }
        if parts.len() as u64 != u64::from(count) {
            let mut there = parts.iter().map(|(_, part)| part.part.index()).peekable();
            let is_missing = |index: &u32| there.next_if_eq(index).is_none();
            let missing: Vec<u32> = (1..=count).filter(is_missing).collect();
            let shown: Vec<String> = missing.iter().take(SHOWN).map(u32::to_string).collect();
            let more = missing.len() - shown.len();
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            return Err(Failure::file(format!(
                "of {} {} missing: {}{more}",
                counted(u64::from(count), "part"),
                if missing.len() == 1 { "one is" } else { "these are" },
                shown.join(", ")
            )));
        }
        let mut whole = Whole {
            size,
            wanted,
            radiance: Vec::new(),
            pixels: Vec::new(),
            hits: Vec::new(),
            costs: Vec::new(),
        };
        for (path, part) in parts {
            let added = append(&mut whole.radiance, part.radiance)
                .and_then(|()| append(&mut whole.pixels, part.pixels))
                .and_then(|()| append(&mut whole.hits, part.hits))
                .and_then(|()| append(&mut whole.costs, part.costs));
            added.map_err(|error| Failure::limit(said(path, &error)))?;
        }
        Ok(whole)
    }
}

/// Parts follow one another in the picture.
fn append<T>(whole: &mut Vec<T>, mut part: Vec<T>) -> Result<(), PartFileError> {
    whole.try_reserve(part.len()).map_err(|_| PartFileError::Memory)?;
    whole.append(&mut part);
    Ok(())
}

/// A part of a picture with these colours, for fuzz targets. `wanted` is JSON as a description has it.
///
/// # Errors
/// What cannot be described.
pub fn part_of(
    (index, count): (u32, u32),
    (width, height): (u32, u32),
    wanted: &str,
    pixels: &[u32],
) -> Result<Vec<u8>, Failure> {
    let wrong = |error: &dyn std::fmt::Display| Failure::usage(error.to_string());
    let part = Part::new(index, count).map_err(|error| wrong(&error))?;
    let size = Size::new(width, height).map_err(|error| wrong(&error))?;
    let wanted: Wanted = serde_json::from_str(wanted).map_err(|error| wrong(&error))?;
    let settings = [("samples".to_owned(), "1".to_owned())].into();
    let outputs = wanted.outputs(true, true);
    let all = |needed: bool| if needed { pixels.len() } else { 0 };
    let made = Made {
        size,
        hits: &vec![FirstHit::MISS; all(outputs.first_hits)],
        costs: &vec![FirstCost::default(); all(outputs.first_costs)],
        radiance: &vec![[0.5; 4]; all(outputs.radiance)],
        pixels: &pixels[..all(outputs.pixels)],
    };
    part_file::to_bytes(part, &wanted, &settings, &made).map_err(|error| wrong(&error))
}

/// Reads the files of parts and puts them together, for fuzz targets: the colours of the picture.
///
/// # Errors
/// As for the verb; messages name the file, `0.picpart` and so on.
pub fn merged(files: &[&[u8]]) -> Result<Vec<u32>, Failure> {
    let names: Vec<PathBuf> =
        (0..files.len()).map(|index| PathBuf::from(format!("{index}.picpart"))).collect();
    let parts =
        names.iter().zip(files).map(|(path, bytes)| Ok((path.as_path(), read(path, bytes)?)));
    let whole = Whole::of(parts.collect::<Result<_, Failure>>()?)?;
    Ok(whole.pixels)
}
