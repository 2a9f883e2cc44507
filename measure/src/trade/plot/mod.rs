//! The plots: points that stand for rows, and times by rays. Points are labelled by the numbers of
//! their rows, which the side of the picture spells out, so that no label grows with its text.

mod axis;
mod draw;
mod place;
mod scatter;
mod totals;

use super::TradeError;
use super::document::Trade;
use crate::paper::file::File;
use crate::paper::plot::{Plot, png, svg};
use scatter::Scatter;
use totals::Totals;

/// A plot as files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Figure {
    /// What it shows.
    pub caption: String,
    /// PNG first, then SVG.
    pub files: [File; 2],
}

/// All plots of a report.
///
/// # Errors
/// [`TradeError::Picture`].
pub fn figures(trade: &Trade) -> Result<Vec<Figure>, TradeError> {
    let mut out = Vec::new();
    for (name, scatter) in Scatter::all(trade) {
        out.push(figure(name, scatter.title.clone(), &scatter)?);
    }
    if let Some(totals) = Totals::of(trade) {
        out.push(figure("total-rays", totals.title.clone(), &totals)?);
    }
    Ok(out)
}

fn figure<P: Plot>(name: &str, caption: String, plot: &P) -> Result<Figure, TradeError> {
    let files = [
        File { name: format!("{name}.png"), bytes: png(plot)? },
        File { name: format!("{name}.svg"), bytes: svg(plot)?.into_bytes() },
    ];
    Ok(Figure { caption, files })
}
