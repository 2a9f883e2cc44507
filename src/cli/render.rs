//! `splitplane render`, which is also what happens without a verb.

use super::failure::Failure;
use super::options::{Common, point, size};
use super::prepared::{BuildReport, Prepared, in_pool, print_json};
use super::{output, progress};
use clap::Args;
use serde::Serialize;
use splitplane::render::{Rendered, Size, render};
use splitplane::scene::{Camera, CameraError, Placement, View};
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// Shown without arguments: enough to see what the tree is for, quick to build.
const DEFAULT_SCENE: &str = "builtin:city";

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj file or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE", default_value = DEFAULT_SCENE)]
    scene: String,
    /// The picture, a .png file; splitplane-SCENE.png in the current folder when left out
    #[arg(long, short, value_name = "FILE.png")]
    output: Option<PathBuf>,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    size: Size,
    /// Where the camera is; chosen to suit the scene when left out
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    camera_eye: Option<[f32; 3]>,
    /// The point it looks at
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    camera_at: Option<[f32; 3]>,
    /// The direction that is up in the picture
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    camera_up: Option<[f32; 3]>,
    /// Angle from the bottom of the picture to its top, in degrees
    #[arg(long, value_name = "DEGREES")]
    fov: Option<f32>,
    #[command(flatten)]
    common: Common,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    if let Some(path) = &arguments.output {
        output::check_ending(path)?;
    }
    in_pool(common, || {
        let prepared = Prepared::open(&arguments.scene, common)?;
        let path = arguments.output.clone().unwrap_or_else(|| default_name(&prepared.scene.name));
        let aspect = arguments.size.aspect();
        let spinner = progress::spinner(common.quiet, "placing the camera");
        let placement = Placement::of(&prepared.scene, prepared.accelerator.as_ref(), aspect)?;
        spinner.finish_and_clear();
        let placement =
            arguments.placement(placement).map_err(|e| Failure::usage(e.to_string()))?;
        let pixels = u64::from(arguments.size.width()) * u64::from(arguments.size.height());
        let bar = progress::bar(common.quiet, "rendering", pixels);
        let rendered = render(
            prepared.accelerator.as_ref(),
            &prepared.scene,
            &placement,
            arguments.size,
            &common.query_options(),
            &|rays| bar.inc(rays),
        )?;
        bar.finish_and_clear();
        write_png(&path, &rendered)?;
        arguments.report(&prepared, &placement, &rendered, &path)
    })
}

impl Arguments {
    fn moves_camera(&self) -> bool {
        let points = [self.camera_eye, self.camera_at, self.camera_up];
        points.iter().any(Option::is_some) || self.fov.is_some()
    }

    /// The placement with whatever the user gave instead.
    fn placement(&self, mut placement: Placement) -> Result<Placement, CameraError> {
        let old = placement.camera;
        if self.moves_camera() {
            placement.camera = Camera::new(
                self.camera_eye.unwrap_or(old.eye()),
                self.camera_at.unwrap_or(old.look_at()),
                self.camera_up.unwrap_or(old.up()),
                self.fov.unwrap_or(old.fov_degrees()),
            )?;
            placement.view = View::Given;
        }
        Ok(placement)
    }

    fn report(
        &self,
        prepared: &Prepared,
        placement: &Placement,
        rendered: &Rendered,
        path: &Path,
    ) -> Result<(), Failure> {
        let primary_ms = rendered.primary.as_secs_f64() * 1e3;
        let (width, height) = (self.size.width(), self.size.height());
        let pixels = u64::from(width) * u64::from(height);
        if self.common.json {
            let output = path.display().to_string();
            let build = prepared.report();
            return print_json(&RenderReport { build, width, height, primary_ms, output });
        }
        if self.common.quiet {
            return Ok(());
        }
        let [x, y, z] = placement.camera.eye();
        output::data(&format!(
            "{}camera   at {x},{y},{z}, {}\n\
             traced   {pixels} camera rays in {primary_ms:.1} ms ({:.1} million a second), {} rays \
             in all; {:.0} % of the picture is covered\n\
             written  {} ({width}x{height})\n",
            prepared.describe(),
            if self.moves_camera() { "as given" } else { placement.view.name() },
            pixels as f64 / primary_ms.max(1e-6) / 1e3,
            rendered.rays,
            100.0 * rendered.covered as f64 / pixels as f64,
            path.display()
        ))
    }
}

/// What `--json` says about a picture.
#[derive(Serialize)]
struct RenderReport {
    #[serde(flatten)]
    build: BuildReport,
    width: u32,
    height: u32,
    primary_ms: f64,
    output: String,
}

/// A name in the current folder that no scene file has.
fn default_name(scene: &str) -> PathBuf {
    let bare = scene.strip_prefix("builtin:").unwrap_or(scene);
    let bare = bare.strip_suffix(".obj").unwrap_or(bare);
    PathBuf::from(format!("splitplane-{}.png", bare.replace([':', '/', '\\'], "-")))
}

fn write_png(path: &Path, rendered: &Rendered) -> Result<(), Failure> {
    let mut bytes = Cursor::new(Vec::new());
    rendered
        .image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .map_err(|error| Failure::file(format!("cannot encode the picture: {error}")))?;
    output::file(path, bytes.get_ref())
}
