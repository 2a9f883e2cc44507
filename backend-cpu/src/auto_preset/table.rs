//! The table of what was measured.

use crate::InstructionSet;
use splitplane_core::config::Preset;
use std::error::Error;
use std::fmt;

/// The columns of a table, in order: its first line that is no comment.
///
/// `set` is an [`InstructionSet`] by name, `size_skew` is [`MeshTraits::size_skew`](super::MeshTraits::size_skew); times are of one
/// thread, of rays in ns each.
pub const COLUMNS: &str =
    "set,preset,scene,triangles,size_skew,build_ms,primary_ns,shadow_ns,bounce_ns,chords_ns";

/// What a preset took on a scene, on one thread.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Row {
    pub(super) set: InstructionSet,
    pub(super) preset: Preset,
    pub(super) scene: String,
    pub(super) triangles: f64,
    pub(super) skew: f64,
    /// Seconds.
    pub(super) build: f64,
    /// Seconds, the mean of the four sets.
    pub(super) ray: f64,
}

/// Why a table cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TableError {
    /// It has no rows.
    Empty,
    /// A line has another number of columns than the first.
    Columns {
        /// Its number, from 1.
        line: usize,
        /// Its columns.
        found: usize,
    },
    /// The first line that is no comment names other columns.
    Header {
        /// What it is.
        found: String,
    },
    /// A value that cannot be.
    Value {
        /// The number of its line, from 1.
        line: usize,
        /// Its column.
        column: &'static str,
        /// What stands there.
        found: String,
    },
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            TableError::Empty => write!(f, "the table has no rows"),
            TableError::Columns { line, found } => {
                write!(
                    f,
                    "line {line} has {found} columns, but must have {}",
                    COLUMNS.split(',').count()
                )
            }
            TableError::Header { found } => {
                write!(f, "the table begins with `{found}`, but must begin with `{COLUMNS}`")
            }
            TableError::Value { line, column, found } => {
                write!(f, "line {line}: `{found}` is no {column}")?;
                match *column {
                    "set" => {
                        write!(f, "; there are portable, sse2, neon, simd128, avx2 and avx512")
                    }
                    "preset" => write!(f, "; there are fast, narrow, balanced and best"),
                    "size_skew" => write!(f, "; give a number from 0 on"),
                    _ => write!(f, "; give a number above 0"),
                }
            }
        }
    }
}

impl Error for TableError {}

/// Reads a table. Lines that are empty or begin with `#` count for nothing.
pub(super) fn parse(text: &str) -> Result<Vec<Row>, TableError> {
    let lines = text.lines().enumerate().map(|(place, line)| (place + 1, line.trim()));
    let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let (_, header) = lines.next().ok_or(TableError::Empty)?;
    if header != COLUMNS {
        return Err(TableError::Header { found: header.to_owned() });
    }
    let rows: Vec<Row> = lines.map(|(line, text)| row(line, text)).collect::<Result<_, _>>()?;
    if rows.is_empty() { Err(TableError::Empty) } else { Ok(rows) }
}

fn row(line: usize, text: &str) -> Result<Row, TableError> {
    let cells: Vec<&str> = text.split(',').map(str::trim).collect();
    let names: Vec<&'static str> = COLUMNS.split(',').collect();
    if cells.len() != names.len() {
        return Err(TableError::Columns { line, found: cells.len() });
    }
    let wrong = |column: usize| TableError::Value {
        line,
        column: names[column],
        found: cells[column].to_owned(),
    };
    let number = |column: usize, least: f64| {
        let number: Option<f64> = cells[column].parse().ok();
        number.filter(|number| number.is_finite() && *number >= least).ok_or_else(|| wrong(column))
    };
    let positive = |column| number(column, f64::MIN_POSITIVE);
    let rays = [positive(6)?, positive(7)?, positive(8)?, positive(9)?];
    Ok(Row {
        set: set(cells[0]).ok_or_else(|| wrong(0))?,
        preset: cells[1].parse().map_err(|_| wrong(1))?,
        scene: cells[2].to_owned(),
        triangles: positive(3)?,
        skew: number(4, 0.0)?,
        build: positive(5)? * 1e-3,
        ray: rays.iter().sum::<f64>() / rays.len() as f64 * 1e-9,
    })
}

fn set(name: &str) -> Option<InstructionSet> {
    let all = [
        InstructionSet::Portable,
        InstructionSet::Sse2,
        InstructionSet::Neon,
        InstructionSet::Simd128,
        InstructionSet::Avx2,
        InstructionSet::Avx512,
    ];
    all.into_iter().find(|set| set.name() == name)
}
