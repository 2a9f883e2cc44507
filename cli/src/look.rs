//! Options of verbs that make pictures: size, samples, camera, lights, what is wanted.

use super::failure::Failure;
use super::options::{Common, bytes, point, size};
use clap::{Args, ValueEnum};
use splitplane::Accelerator;
use splitplane::render::{
    Environment, FrameStats, Gather, Light, LightTransport, Part, RenderSettings, Size,
};
use splitplane::scene::environment::EnvironmentOptions;
use splitplane::scene::{
    self, Camera, InstancedScene, MaterialRule, Placement, Scene, SceneOptions, View,
};
use std::sync::Arc;

mod around;

use around::{Lamp, Surroundings, environment, lamp};

/// [`SceneOptions::DECODE_LIMIT`] as users write it.
pub(super) const MAX_TEXTURE: &str = "512M";

/// Bounces of paths when nothing is said: light of all surfaces but the whitest is spent by then.
const PATHS_DEPTH: u32 = 32;

/// How light travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Transport {
    /// Straight from lights, and through mirrors and glass
    Direct,
    /// By any way, traced from the eye: path tracing
    Paths,
    /// By any way, traced from the lights too: photon mapping
    Photons,
}

impl From<Transport> for LightTransport {
    fn from(transport: Transport) -> LightTransport {
        match transport {
            Transport::Direct => LightTransport::Direct,
            Transport::Paths => LightTransport::Paths,
            Transport::Photons => LightTransport::Photons,
        }
    }
}

/// Where photons are looked up.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum GatherName {
    /// At the first surface that scatters light
    Maps,
    /// One bounce later, but for caustics
    Final,
}

impl From<GatherName> for Gather {
    fn from(name: GatherName) -> Gather {
        match name {
            GatherName::Maps => Gather::Maps,
            GatherName::Final => Gather::Final,
        }
    }
}

#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Picture")]
pub(super) struct Look {
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    pub(super) size: Size,
    /// Camera rays a pixel, 1 to 64; when left out 4 for still pictures, 16 where surfaces or a picture around shine,
    /// and 1 in animations
    #[arg(long, value_name = "N")]
    samples: Option<u32>,
    /// How light travels. All but `direct` the CPU shades; a GPU traces the rays
    #[arg(long, value_enum, default_value_t = Transport::Direct)]
    transport: Transport,
    /// How often the picture is made, each time by other samples, 1 to 65536; it is the mean. More than 1 the
    /// CPU shades
    #[arg(long, value_name = "N", default_value_t = RenderSettings::default().passes)]
    passes: u32,
    /// Photons that leave the lights in each pass, 64 to 16777216, and at least one of each light; 100000 when
    /// left out. With `--transport photons` only, as the next two
    #[arg(long, value_name = "N")]
    photons: Option<u32>,
    /// How many of the nearest photons light a point, 8 to 1024; 64 when left out
    #[arg(long, value_name = "N")]
    neighbours: Option<u32>,
    /// Where photons are looked up; `maps` when left out
    #[arg(long, value_enum)]
    gather: Option<GatherName>,
    /// Most reflections and refractions along a path, 0 to 16; with other light than `--transport direct` of
    /// all bounces, of paths and of photons, 0 to 64; 6 and 32 when left out
    #[arg(long, value_name = "N")]
    depth: Option<u32>,
    /// A path ends when less than this part of its light reaches the eye, 0 to 1; 0.00390625 when left out.
    /// With `--transport direct` only
    #[arg(long, value_name = "PART")]
    min_weight: Option<f32>,
    /// Where random samples of shining surfaces start from
    #[arg(long, value_name = "N", default_value_t = RenderSettings::default().seed)]
    seed: u32,
    /// Factor of the light before it is shown; .exr files are not changed
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    exposure: f32,
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
    /// A light at a point, in place of all others; may be given many times. R,G,B is the irradiance
    /// at the point looked at, 3.4 shared by all lights when left out
    #[arg(long, value_name = "X,Y,Z[,R,G,B]", value_parser = lamp, allow_hyphen_values = true)]
    #[arg(conflicts_with_all = ["lights", "no_lights"])]
    light: Vec<Lamp>,
    /// A light from far away, given by the direction towards it, in place of all others; may be given
    /// many times
    #[arg(long, value_name = "X,Y,Z[,R,G,B]", value_parser = lamp, allow_hyphen_values = true)]
    #[arg(conflicts_with_all = ["lights", "no_lights"])]
    sun: Vec<Lamp>,
    /// How many lights to place in a scene that has none of its own, 1 to 8
    #[arg(long, value_name = "N", default_value_t = 1)]
    #[arg(value_parser = clap::value_parser!(u8).range(1..=Placement::MAX_LIGHTS as i64))]
    lights: u8,
    /// No lights but surfaces that shine and the environment
    #[arg(long)]
    no_lights: bool,
    /// Samples of shining surfaces for every surface point, 0 to 8
    #[arg(long, value_name = "N", default_value_t = RenderSettings::default().area_samples)]
    area_samples: u32,
    /// Part of the environment's light that surfaces receive, 0 to 1; 0.4 outside, and 0.15 in scenes
    /// that keep most of it off, when left out. With `--transport direct` only
    #[arg(long, value_name = "PART")]
    ambient: Option<f32>,
    /// A light at the eye without shadows; 0.2 where lights were placed, else 0, when left out. With
    /// `--transport direct` only
    #[arg(long, value_name = "RADIANCE")]
    headlight: Option<f32>,
    /// Light from everywhere, and the backdrop: a colour, or a picture of all directions, .hdr or .exr, whose middle is
    /// towards -z, which the CPU shades; what the scene file says, else `sky`, when left out
    #[arg(long, value_name = "sky|black|R,G,B|FILE", value_parser = environment)]
    environment: Option<Surroundings>,
    /// Turns the picture of --environment about y, counter-clockwise seen from above
    #[arg(long, value_name = "DEGREES", requires = "environment", allow_hyphen_values = true)]
    environment_rotation: Option<f32>,
    /// Factor of the light of the picture of --environment, 0 to 1e12
    #[arg(long, value_name = "FACTOR", requires = "environment")]
    environment_strength: Option<f32>,
    /// Which surfaces of .mtl files are mirrors
    #[arg(long, value_enum, default_value_t = MaterialsName::Illum)]
    materials: MaterialsName,
    /// Leave the textures of .mtl files out
    #[arg(long)]
    no_textures: bool,
    /// Most bytes that decoding one texture may take; all together may take sixteen times as many, one
    /// after the other. Textures past it are left out
    #[arg(long, value_name = "BYTES", value_parser = bytes, default_value = MAX_TEXTURE)]
    max_texture: u64,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum MaterialsName {
    /// Those whose `illum` says so
    Illum,
    /// All with a `Ks`, as scenes made for ray tracers mean it
    Specular,
}

impl MaterialsName {
    /// The rule of this name.
    pub(super) const fn rule(self) -> MaterialRule {
        match self {
            MaterialsName::Illum => MaterialRule::Illum,
            MaterialsName::Specular => MaterialRule::Specular,
        }
    }
}

impl Look {
    /// How files become scenes.
    pub(super) fn scene_options(&self, common: &Common) -> SceneOptions {
        SceneOptions {
            materials: self.materials.rule(),
            textures: !self.no_textures,
            decode_limit: self.max_texture,
            file_limit: common.max_file,
            memory_limit: common.max_memory,
            ..SceneOptions::default()
        }
    }

    /// About how many rays a picture of so many samples takes, unless the user says otherwise: one for each sample, and one to each light
    /// for each of them. More where surfaces mirror, fewer where rays miss; lights that are to be placed are all there.
    pub(super) fn announced_rays(&self, scene: &Scene, samples: u32) -> u64 {
        let of_user = self.light.len() + self.sun.len();
        let lights = match (of_user, scene.is_lit()) {
            _ if self.no_lights => 0,
            (0, true) => scene.lights.len() as u64 + u64::from(self.area_samples),
            (0, false) => u64::from(self.lights),
            (count, _) => count as u64,
        };
        let pixels = u64::from(self.size.width()) * u64::from(self.size.height());
        let paths = u64::from(self.samples.unwrap_or(samples)) * u64::from(self.passes);
        pixels.saturating_mul(paths).saturating_mul(1 + lights)
    }

    /// Whether the camera is the user's.
    pub(super) fn moves_camera(&self) -> bool {
        let points = [self.camera_eye, self.camera_at, self.camera_up];
        points.iter().any(Option::is_some) || self.fov.is_some()
    }

    /// A camera with whatever the user gave instead.
    pub(super) fn camera(&self, old: Camera) -> Result<Camera, Failure> {
        if !self.moves_camera() {
            return Ok(old);
        }
        Camera::new(
            self.camera_eye.unwrap_or(old.eye()),
            self.camera_at.unwrap_or(old.look_at()),
            self.camera_up.unwrap_or(old.up()),
            self.fov.unwrap_or(old.fov_degrees()),
        )
        .map_err(|error| Failure::usage(error.to_string()))
    }

    /// Camera and lights: the user's, else the scene's own, else placed by rule.
    pub(super) fn place(
        &self,
        scene: &mut Scene,
        accelerator: &dyn Accelerator,
    ) -> Result<Placed, Failure> {
        let (count, aspect) = (usize::from(self.lights), self.size.aspect());
        let mut placement = Placement::of_with(scene, accelerator, aspect, count)?;
        let camera = self.camera(placement.camera)?;
        if self.moves_camera() {
            // Lights are placed for what is seen.
            scene.camera = Some(camera);
            placement = Placement::of_with(scene, accelerator, aspect, count)?;
        }
        let of_user = self.lights_of_user(&camera)?;
        let by_rule = of_user.is_none() && !scene.is_lit();
        Ok(Placed {
            camera,
            view: if self.moves_camera() { None } else { Some(placement.view) },
            inside: placement.inside,
            lights: of_user.unwrap_or(placement.lights),
            by_rule,
            asked: count,
        })
    }

    /// As [`Look::place`] for a scene of many objects, which is looked at from outside.
    pub(super) fn place_objects(&self, scene: &mut InstancedScene) -> Result<Placed, Failure> {
        let (count, aspect) = (usize::from(self.lights), self.size.aspect());
        let mut placement = scene.placement(aspect, count);
        let camera = self.camera(placement.camera)?;
        if self.moves_camera() {
            scene.parts.camera = Some(camera);
            placement = scene.placement(aspect, count);
        }
        let of_user = self.lights_of_user(&camera)?;
        Ok(Placed {
            camera,
            view: if self.moves_camera() { None } else { Some(placement.view) },
            inside: false,
            by_rule: of_user.is_none() && !scene.is_lit(),
            lights: of_user.unwrap_or(placement.lights),
            asked: count,
        })
    }

    fn lights_of_user(&self, camera: &Camera) -> Result<Option<Vec<Light>>, Failure> {
        if self.no_lights {
            return Ok(Some(Vec::new()));
        }
        let count = self.light.len() + self.sun.len();
        if count == 0 {
            return Ok(None);
        }
        let share = [3.4 / count as f32; 3];
        let at = camera.look_at();
        let mut lights = Vec::with_capacity(count);
        for lamp in &self.light {
            let irradiance = lamp.irradiance.unwrap_or(share);
            lights.push(Light::point_for(lamp.place, at, irradiance));
        }
        for sun in &self.sun {
            if sun.place == [0.0; 3] {
                return Err(Failure::usage(
                    "the direction of --sun is zero; give one such as 1,2,1",
                ));
            }
            let irradiance = sun.irradiance.unwrap_or(share);
            lights.push(Light::Directional { towards: sun.place, irradiance });
        }
        Ok(Some(lights))
    }

    /// Puts what is around into a scene: what the user says, else what is there.
    pub(super) fn surround(&self, scene: &mut Scene, common: &Common) -> Result<(), Failure> {
        match &self.environment {
            None => {}
            Some(Surroundings::Colours(_)) => scene.environment = None,
            Some(Surroundings::File(path)) => {
                let options = EnvironmentOptions {
                    rotation_degrees: self.environment_rotation.unwrap_or(0.0),
                    strength: self.environment_strength.unwrap_or(1.0),
                    decode_limit: self.max_texture,
                    file_limit: common.max_file,
                };
                let read = scene::environment::read(path, &options)?;
                scene.notes.warnings.extend(read.note(path));
                scene.environment = Some(Arc::new(read.map));
            }
        }
        if scene.environment.is_some() && self.ambient.is_some() {
            return Err(Failure::usage(
                "--ambient is of environments of colours: of a picture all light is sampled, with its shadows; leave it out",
            ));
        }
        Ok(())
    }

    /// Refuses options that would do nothing.
    pub(super) fn check_transport(&self) -> Result<(), Failure> {
        let direct = [
            ("--min-weight", self.min_weight.is_some()),
            ("--ambient", self.ambient.is_some()),
            ("--headlight", self.headlight.is_some()),
        ];
        let photons = [
            ("--photons", self.photons.is_some()),
            ("--neighbours", self.neighbours.is_some()),
            ("--gather", self.gather.is_some()),
        ];
        let without = |options: &[(&'static str, bool)], why: &str| match options
            .iter()
            .find(|(_, given)| *given)
        {
            Some((option, _)) => Err(Failure::usage(format!("{option} {why}"))),
            None => Ok(()),
        };
        let is_file = matches!(self.environment, Some(Surroundings::File(_)));
        if !is_file {
            let of_files = [
                ("--environment-rotation", self.environment_rotation.is_some()),
                ("--environment-strength", self.environment_strength.is_some()),
            ];
            without(&of_files, "is of pictures: give --environment the path of a .hdr or .exr")?;
        }
        if self.transport != Transport::Direct {
            without(
                &direct,
                "is of direct light: paths and photons bring all light, and chance ends them; leave it out, or \
                 take --transport direct",
            )?;
        }
        if self.transport != Transport::Photons {
            without(&photons, "needs --transport photons")?;
        }
        Ok(())
    }

    fn headlight(&self, by_rule: bool) -> f32 {
        let usual = if by_rule { RenderSettings::PLACED_HEADLIGHT } else { 0.0 };
        self.headlight.unwrap_or(usual)
    }

    /// The settings of a frame, for this many samples unless the user says otherwise.
    pub(super) fn settings(
        &self,
        samples: u32,
        placed: &Placed,
    ) -> Result<RenderSettings, Failure> {
        let settings = RenderSettings {
            samples: self.samples.unwrap_or(samples),
            depth: self.depth.unwrap_or(match self.transport {
                Transport::Direct => RenderSettings::default().depth,
                Transport::Paths | Transport::Photons => PATHS_DEPTH,
            }),
            minimum_weight: self.min_weight.unwrap_or(RenderSettings::default().minimum_weight),
            area_samples: self.area_samples,
            seed: self.seed,
            ambient: self.ambient.unwrap_or(if placed.inside {
                RenderSettings::INSIDE_AMBIENT
            } else {
                RenderSettings::default().ambient
            }),
            headlight: self.headlight(placed.by_rule),
            exposure: self.exposure,
            environment: match self.environment {
                Some(Surroundings::Colours(environment)) => environment,
                _ => Environment::SKY,
            },
            light: self.transport.into(),
            passes: self.passes,
            photons: self.photons.unwrap_or(RenderSettings::default().photons),
            neighbours: self.neighbours.unwrap_or(RenderSettings::default().neighbours),
            gather: self.gather.map_or(Gather::Maps, Gather::from),
            part: Part::WHOLE,
        };
        settings.validate().map_err(|error| Failure::usage(error.to_string()))?;
        Ok(settings)
    }
}

/// How many rays photons had.
pub(super) fn of_photons(stats: &FrameStats) -> String {
    match stats.photon_rays {
        0 => String::new(),
        rays => format!(", {rays} of photons"),
    }
}

/// Where the camera and the lights are.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    pub(super) camera: Camera,
    /// How the camera came to its place; `None` when the user put it there.
    pub(super) view: Option<View>,
    pub(super) lights: Vec<Light>,
    /// Whether the lights were placed for want of any.
    pub(super) by_rule: bool,
    /// How many were asked for.
    asked: usize,
    /// Whether the scene is an interior.
    inside: bool,
}

impl Placed {
    /// How many lights were to be placed, where they were.
    pub(super) fn asked(&self) -> Option<usize> {
        self.by_rule.then_some(self.asked)
    }
}
