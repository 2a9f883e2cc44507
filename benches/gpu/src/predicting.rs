//! Predictions of a scene: counted here, for a device that may be another.

use splitplane::gpu::{Gpu, KernelTime};
use splitplane::scene::{Placement, Scene};
use splitplane::{BuildOptions, CpuBackend, Mesh, Preset, Ray};

use crate::Failure;
use crate::count::build::{self, CountedBuild};
use crate::count::device::Counter;
use crate::count::rays::{self, Through};
use crate::count::table as counts;
use crate::model::devices::{DEVICES, Device};
use crate::model::{scale, table};
use crate::options::Options;
use crate::rays::in_tiles;

/// Rays that predictions are about: a picture of 1920 by 1080.
const RAYS: u64 = 1920 * 1080;

/// What was measured of a scene on the device at hand.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Measured<'a> {
    pub times: &'a [KernelTime],
    /// Million closest hits of primary rays a second.
    pub primary: Option<f64>,
}

/// The devices to predict for: those asked for, or that at hand where it is known, or the first.
///
/// # Errors
/// A name that the table does not have.
pub(crate) fn devices(options: &Options, gpu: &Gpu) -> Result<Vec<&'static Device>, Failure> {
    if !options.device.is_empty() {
        let names: Vec<_> = DEVICES.iter().map(|device| device.name).collect();
        let unknown = |name: &str| format!("no device {name}: there are {}", names.join(", "));
        let found = options
            .device
            .iter()
            .map(|name| crate::model::devices::find(name).ok_or_else(|| unknown(name).into()));
        return found.collect();
    }
    let at_hand = crate::model::devices::find(&gpu.info().name);
    Ok(match at_hand {
        Some(device) => vec![device],
        None if options.predict => DEVICES.iter().collect(),
        None => vec![&DEVICES[0]],
    })
}

/// Counts a scene and says what its builds and its camera's rays would take.
pub(crate) fn scene(
    counter: &Counter,
    name: &str,
    preset: Preset,
    devices: &[&'static Device],
    options: &Options,
    measured: Measured<'_>,
) -> Result<String, Failure> {
    let mut out = format!("\n### {name}, {}\n\n", preset.name());
    let adapter = &counter.backend.gpu().info().name;
    // A device that is not in the table is measured all the same, beside one that is.
    let another = |device: &Device| !measured.times.is_empty() && !adapter.contains(device.adapter);
    let title = |device: &Device| {
        let beside = if another(device) {
            format!("; measured on another device, {adapter}")
        } else {
            String::new()
        };
        format!("\nPredicted for `{}`{beside}:\n\n", device.name)
    };
    let most = options.counted_triangles(counter.backend.gpu().info().device_type);
    if let Some(triangles) = too_large(name, most) {
        let (counted, how) = scaled(counter, preset, triangles, most)?;
        out.push_str(&how);
        for device in devices {
            out += &title(device);
            out += &table::build(device, &counted, measured.times);
        }
        return Ok(out);
    }
    let scene = Scene::open(name)?;
    let mesh = scene.mesh()?;
    if !options.no_builds {
        let counted = build::count(counter, &mesh, preset)?;
        out += &format!("{} triangles, counted:\n\n{}", counted.triangles, counts::table(&counted));
        for device in devices {
            out += &title(device);
            out += &table::build(device, &counted, measured.times);
        }
    }
    if !options.no_rays {
        let primary = primary(&scene, &mesh, preset, options)?;
        let counted = rays::count(counter, &mesh, preset, &primary)?;
        out += &format!(
            "\nClosest hits of primary rays, {} of them counted, in tiles of 8 by 4 pixels:\n",
            primary.len()
        );
        let through = if options.compressed { Through::Compressed } else { Through::Tree };
        for device in devices {
            out += &title(device);
            out += &table::rays(device, &counted, RAYS, measured.primary.map(|it| (through, it)));
        }
    }
    Ok(out)
}

/// The triangles of a built-in city that is not counted but scaled.
fn too_large(name: &str, most: u64) -> Option<u64> {
    let triangles: u64 = name.strip_prefix("builtin:city:")?.parse().ok()?;
    (triangles > most).then_some(triangles)
}

/// Two smaller cities, counted, and what becomes of them.
fn scaled(
    counter: &Counter,
    preset: Preset,
    triangles: u64,
    large: u64,
) -> Result<(CountedBuild, String), Failure> {
    let [few, many] = [large / 4, large].map(|size| -> Result<CountedBuild, Failure> {
        let scene = Scene::open(format!("builtin:city:{size}"))?;
        build::count(counter, &scene.mesh()?, preset)
    });
    let (few, many) = (few?, many?);
    let growth = many.triangles as f64 / few.triangles as f64;
    let (a, b) = (few.all(), many.all());
    let power = |a: u64, b: u64| scale::exponent(a as f64, b as f64, growth);
    let how = format!(
        "Not counted: scaled from cities of {} and {} triangles, each count of each kernel by its own power of the \
         number of triangles, dispatches taken as alike. Of all kernels together: bytes by {:.2}, operations by {:.2}, \
         the longest chain by {:.2}, dispatches by {:.2}.\n",
        few.triangles,
        many.triangles,
        power(a.bytes(), b.bytes()),
        power(a.operations, b.operations),
        power(a.longest_operations, b.longest_operations),
        power(a.dispatches, b.dispatches),
    );
    Ok((scale::scaled(&few, &many, triangles), how))
}

/// Rays of the scene's camera.
fn primary(
    scene: &Scene,
    mesh: &Mesh<'_>,
    preset: Preset,
    options: &Options,
) -> Result<Vec<Ray>, Failure> {
    let build = BuildOptions::from(preset.config());
    let cpu = CpuBackend::new().build_accelerator(mesh, &build)?;
    let [width, height] = options.counted_picture();
    let placement = Placement::of(scene, &cpu, f64::from(width) / f64::from(height))?;
    Ok(in_tiles(&placement.camera.rays(width, height), width))
}
