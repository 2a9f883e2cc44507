//! What decides a picture, by name: parts of one picture must agree in all of it.

use super::failure::Failure;
use super::objects::ObjectStage;
use super::stage::Stage;
use splitplane::core::tree::digest::Xxh64;
use splitplane::core::tree::file::mesh_digest;
use splitplane::render::{Environment, Gather, LightTransport, Pinhole, RenderSettings, SceneData};
use splitplane::tracer::FrameRequest;
use splitplane::{Accuracy, BackendInfo, Culling, Digest};
use std::collections::BTreeMap;

/// Values by name, as text.
pub(super) type Settings = BTreeMap<String, String>;

/// Those of a picture of one mesh.
pub(super) fn of_mesh(stage: &Stage, request: &FrameRequest<'_>) -> Result<Settings, Failure> {
    let mut settings = of_request(request, &stage.info);
    put(&mut settings, "tree", stage.tracer.digest()?);
    put(&mut settings, "triangles", mesh_digest(&stage.scene.mesh()?));
    put(&mut settings, "materials and lights", look(stage.tracer.appearance(), &[]));
    Ok(settings)
}

/// Those of a picture of many objects.
pub(super) fn of_objects(
    stage: &ObjectStage,
    request: &FrameRequest<'_>,
) -> Result<Settings, Failure> {
    let mut settings = of_request(request, &stage.info);
    put(&mut settings, "tree", stage.tracer.scene().scene().digest());
    put(&mut settings, "triangles", mesh_digest(&stage.scene.parts.mesh()?));
    let (_, materials) = stage.scene.numbers();
    put(&mut settings, "materials and lights", look(stage.tracer.appearance(), &materials));
    Ok(settings)
}

fn put(settings: &mut Settings, name: &str, value: impl ToString) {
    settings.insert(name.to_owned(), value.to_string());
}

/// A name of what surfaces look like and of what lights them.
fn look(scene: &SceneData, materials: &[u32]) -> Digest {
    let mut state = Xxh64::new(1);
    state.write_words(scene.words());
    state.write_words(materials);
    if let Some(map) = scene.environment() {
        state.write(&map.digest().0.to_le_bytes());
    }
    Digest(state.finish())
}

/// What the scene does not decide. Numbers are written so that they are read as they were.
fn of_request(request: &FrameRequest<'_>, info: &BackendInfo) -> Settings {
    let FrameRequest { camera, settings, query, .. } = request;
    let Pinhole { eye, corner, step_x, step_y } = camera;
    // Whoever adds a setting decides here whether it must be the same.
    let RenderSettings {
        samples,
        depth,
        minimum_weight,
        area_samples,
        seed,
        ambient,
        headlight,
        exposure,
        environment: Environment { zenith, horizon, nadir },
        light,
        passes,
        photons,
        neighbours,
        gather,
        part: _,
    } = settings;
    let mut all = Settings::new();
    let mut put = |name: &str, value: String| put(&mut all, name, value);
    put("program", env!("CARGO_PKG_VERSION").to_owned());
    put("arithmetic", arithmetic(info, query.accuracy));
    put("accuracy", query.accuracy.name().to_owned());
    put("camera", format!("{:?}", [eye, corner, step_x, step_y]));
    put("samples", samples.to_string());
    put("depth", depth.to_string());
    put("area samples", area_samples.to_string());
    put("seed", seed.to_string());
    put("exposure", format!("{exposure:?}"));
    put("environment", format!("{:?}", [zenith, horizon, nadir]));
    put("passes", passes.to_string());
    let transport = match light {
        LightTransport::Direct => "direct",
        LightTransport::Paths => "paths",
        LightTransport::Photons => "photons",
        _ => "another",
    };
    put("transport", transport.to_owned());
    if *light == LightTransport::Direct {
        put("least weight", format!("{minimum_weight:?}"));
        put("ambient", format!("{ambient:?}"));
        put("headlight", format!("{headlight:?}"));
    }
    if *light == LightTransport::Photons {
        put("photons", photons.to_string());
        put("neighbours", neighbours.to_string());
        let gather = if *gather == Gather::Final { "final" } else { "maps" };
        put("gather", gather.to_owned());
    }
    let culling = match query.culling {
        Culling::None => "none",
        Culling::Back => "back",
        Culling::Front => "front",
    };
    put("culling", culling.to_owned());
    all
}

/// Whose bits a picture has. Devices that are known to compute as the CPU does have its bits, but for the fast test, which
/// they may fuse.
fn arithmetic(info: &BackendInfo, accuracy: Accuracy) -> String {
    let is_bitwise = accuracy != Accuracy::Fast && info.detail.ends_with("parity bitwise");
    match &info.adapter {
        Some(adapter) if !is_bitwise => format!("that of {adapter}, {}", info.detail),
        _ => "that of the CPU".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane::render::Size;

    /// Each setting that changes a picture changes what is compared.
    #[test]
    fn every_setting_is_compared() {
        let size = Size::new(4, 3).unwrap();
        let request = FrameRequest::new(Pinhole::default(), size);
        let info = BackendInfo::new("cpu");
        let change = |change: &dyn Fn(&mut FrameRequest<'_>)| {
            let mut changed = request;
            // Photons have most settings.
            changed.settings.light = LightTransport::Photons;
            let before = of_request(&changed, &info);
            change(&mut changed);
            assert_ne!(of_request(&changed, &info), before);
        };
        change(&|r| r.camera.step_y[1] = f32::from_bits(1));
        change(&|r| r.query.accuracy = Accuracy::Fast);
        change(&|r| r.query.culling = Culling::Back);
        change(&|r| r.settings.samples += 1);
        change(&|r| r.settings.depth += 1);
        change(&|r| r.settings.area_samples += 1);
        change(&|r| r.settings.seed += 1);
        change(&|r| r.settings.exposure += 1e-7);
        change(&|r| r.settings.environment.nadir[2] += 1e-7);
        change(&|r| r.settings.light = LightTransport::Paths);
        change(&|r| r.settings.passes += 1);
        change(&|r| r.settings.photons += 1);
        change(&|r| r.settings.neighbours += 1);
        change(&|r| r.settings.gather = Gather::Final);
        for direct in [
            |r: &mut FrameRequest<'_>| r.settings.ambient += 1e-7,
            |r: &mut FrameRequest<'_>| r.settings.headlight += 1e-7,
            |r: &mut FrameRequest<'_>| r.settings.minimum_weight += 1e-7,
        ] {
            let mut changed = request;
            direct(&mut changed);
            assert_ne!(of_request(&changed, &info), of_request(&request, &info));
        }
        let mut device = BackendInfo::new("wgpu");
        device.adapter = Some("some card".into());
        device.detail = "vulkan, driver 1, parity bitwise".into();
        assert_eq!(of_request(&request, &device), of_request(&request, &info));
        let mut fast = request;
        fast.query.accuracy = Accuracy::Fast;
        assert_ne!(of_request(&fast, &device), of_request(&fast, &info));
        device.detail = "vulkan, driver 1, parity structural".into();
        assert_ne!(of_request(&request, &device), of_request(&request, &info));
    }
}
