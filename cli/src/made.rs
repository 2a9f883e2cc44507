//! What verbs ask of a picture besides light, and how what was made becomes files.

use super::failure::Failure;
use super::files::{self, ends_in};
use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};
use splitplane::picture::{self, Aov, FirstCost, FirstHit, HeatMap, Quantity};
use splitplane::render::{Outputs, Size};
use splitplane_scene::from_file::quoted_path;
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

/// What a picture is to show.
#[derive(Args, Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wanted {
    /// What else to write of the first ray of every pixel: beside a .png as pictures of their own, into
    /// an .exr as further channels
    #[arg(long, value_name = "LIST", value_enum, value_delimiter = ',')]
    aov: Vec<AovName>,
    /// In place of the picture, what the first ray of every pixel costs, with a scale
    #[arg(long, value_name = "WHAT", value_enum, conflicts_with = "aov")]
    heatmap: Option<QuantityName>,
    /// The value at the top of the scale; chosen to suit the picture when left out
    #[arg(long, value_name = "COUNT", requires = "heatmap")]
    heatmap_top: Option<NonZeroU32>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum AovName {
    /// Distance from the eye
    Depth,
    /// Unit normal of the triangle
    Normal,
    /// Index of the triangle; of many objects within its geometry
    Triangle,
    /// Which of many objects it is
    Instance,
    /// Nodes visited
    Nodes,
    /// Triangles tested
    Tests,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum QuantityName {
    /// Nodes visited
    Nodes,
    /// Triangles tested
    Triangles,
}

impl Wanted {
    /// Whether it shows costs in place of light.
    pub(super) fn is_heatmap(&self) -> bool {
        self.heatmap.is_some()
    }

    /// Refuses names of files that do not say how such a picture is written.
    pub(super) fn check_ending(&self, path: &Path) -> Result<(), Failure> {
        let shown = quoted_path(path);
        match (ends_in(path, "png"), ends_in(path, "exr"), self.heatmap) {
            (true, ..) | (_, true, None) => Ok(()),
            (_, true, Some(_)) => {
                Err(Failure::usage(format!("`{shown}`: heat maps are written as .png")))
            }
            _ => Err(Failure::usage(format!(
                "`{shown}` does not end in .png or .exr; these are the formats of pictures"
            ))),
        }
    }

    fn wants(&self, name: AovName) -> bool {
        self.aov.contains(&name)
    }

    /// What a tracer must make, for a screen, for linear light, or for both.
    pub(super) fn outputs(&self, pixels: bool, radiance: bool) -> Outputs {
        let hits = [AovName::Depth, AovName::Normal, AovName::Triangle, AovName::Instance];
        let light = self.heatmap.is_none();
        Outputs {
            pixels: pixels && light,
            radiance: radiance && light,
            first_hits: hits.into_iter().any(|name| self.wants(name)),
            first_costs: self.heatmap.is_some()
                || self.wants(AovName::Nodes)
                || self.wants(AovName::Tests),
        }
    }

    /// Writes the files of a picture.
    pub(super) fn write(&self, path: &Path, made: &Made<'_>) -> Result<Written, Failure> {
        let Made { size, hits, costs, radiance, pixels } = *made;
        let mut written = Written { files: vec![path.to_owned()], heat: None };
        if let Some(quantity) = self.heatmap {
            let quantity = match quantity {
                QuantityName::Nodes => Quantity::Nodes,
                QuantityName::Triangles => Quantity::Tests,
            };
            let map = HeatMap::new(size, costs, quantity, self.heatmap_top)?;
            files::write(path, &picture::encode_png(&map.image)?)?;
            let of = &map.statistics;
            written.heat = Some(format!(
                "cost     {} a ray, first rays of pixels: mean {:.1}, median {}, 95 % at most {}, greatest {}\n",
                if quantity == Quantity::Nodes { "nodes visited" } else { "triangles tested" },
                of.mean,
                of.p50,
                of.p95,
                of.max
            ));
            return Ok(written);
        }
        let aovs: Vec<Aov<'_>> = [
            (AovName::Depth, Aov::Depth(hits)),
            (AovName::Normal, Aov::Normal(hits)),
            (AovName::Triangle, Aov::Triangle(hits)),
            (AovName::Instance, Aov::Instance(hits)),
            (AovName::Nodes, Aov::Nodes(costs)),
            (AovName::Tests, Aov::Tests(costs)),
        ]
        .into_iter()
        .filter_map(|(name, aov)| self.wants(name).then_some(aov))
        .collect();
        if ends_in(path, "exr") {
            files::write(path, &picture::encode_exr(size, radiance, &aovs)?)?;
            return Ok(written);
        }
        let screen = picture::screen(size, pixels)?;
        files::write(path, &picture::encode_png(&screen)?)?;
        for aov in aovs {
            let beside = path.with_extension(format!("{}.png", aov.name()));
            files::write(&beside, &picture::encode_png(&aov.picture(size)?)?)?;
            written.files.push(beside);
        }
        Ok(written)
    }
}

/// What a tracer made; empty where it was not asked for.
#[derive(Clone, Copy)]
pub(super) struct Made<'a> {
    pub(super) size: Size,
    pub(super) hits: &'a [FirstHit],
    pub(super) costs: &'a [FirstCost],
    pub(super) radiance: &'a [[f32; 4]],
    pub(super) pixels: &'a [u32],
}

/// What came of a frame.
pub(super) struct Written {
    pub(super) files: Vec<PathBuf>,
    /// What a heat map says in numbers.
    pub(super) heat: Option<String>,
}

impl Written {
    /// The names of the files.
    pub(super) fn names(&self) -> Vec<String> {
        self.files.iter().map(|file| file.display().to_string()).collect()
    }
}
