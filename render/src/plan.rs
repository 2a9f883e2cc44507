//! The work and memory of a frame: only what its scene, its settings and its outputs need.

mod explain;

use crate::Pinhole;
use crate::kernel::{Buffer, DEFERRED_HEAD, DEFERRED_WORDS, Kernel, UNDECIDED_WORDS};
use crate::layout::Frame;
use crate::scene_data::{NONE, Needs, SceneData};
use crate::settings::{
    Gather, LightTransport, MAX_SHADOW_RAYS, RenderSettings, SettingsError, Size,
};
use core::ops::Range;
use splitplane_core::ray::{Culling, QueryOptions};
use thiserror::Error;

/// The outputs of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outputs {
    /// Pixels for a screen.
    pub pixels: bool,
    /// Linear radiance.
    pub radiance: bool,
    /// The hit of the first ray of every pixel: depth, normal, triangle.
    pub first_hits: bool,
    /// The cost of the first ray of every pixel.
    pub first_costs: bool,
}

impl Outputs {
    /// A picture for a screen, nothing else.
    pub const PIXELS: Outputs =
        Outputs { pixels: true, radiance: false, first_hits: false, first_costs: false };

    /// Whether any output needs light.
    pub const fn shades(&self) -> bool {
        self.pixels || self.radiance
    }
}

/// Limits of the queues of a frame. Results do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Room {
    /// Most paths of a wave.
    pub paths: u32,
    /// Most bytes of one buffer.
    pub buffer_bytes: u64,
    /// Whether the rays of a wave may all be left undecided, and come back in a list: those of an exact frame on a device.
    pub undecided: bool,
}

impl Room {
    /// Keeps a few cores busy and most of a wave in their caches.
    pub const CPU: Room = Room { paths: 1 << 16, buffer_bytes: 1 << 30, undecided: false };
    /// Fills a large GPU, within WebGPU's default limit of a binding.
    pub const GPU: Room = Room { paths: 1 << 20, buffer_bytes: 128 << 20, undecided: false };
}

/// Least capacity for paths of scenes whose paths may split.
const LEAST_BRANCHING_ROOM: u64 = 1 << 16;

/// Why a frame cannot be planned.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum PlanError {
    /// A setting is out of its range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// More lights than a surface can sample.
    #[error(
        "every surface would cast {rays} shadow rays, and at most {MAX_SHADOW_RAYS} are possible; use \
         fewer lights or fewer samples of shining surfaces"
    )]
    TooManyLights {
        /// Lights and samples of shining surfaces.
        rays: u64,
    },
    /// A buffer larger than the limit of one.
    #[error("the {what} needs {needed} bytes, but a buffer can have {allowed}")]
    TooLarge {
        /// The buffer.
        what: &'static str,
        /// Bytes it needs.
        needed: u64,
        /// Bytes that it may have.
        allowed: u64,
    },
}

/// The plan of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    size: Size,
    settings: RenderSettings,
    outputs: Outputs,
    /// What the scene needs.
    needs: Needs,
    scene_words: u32,
    triangles: u32,
    slice_pixels: u32,
    path_room: u32,
    shadow_room: u32,
    /// As [`Room::undecided`].
    undecided: bool,
    /// As [`Room::buffer_bytes`].
    buffer_bytes: u64,
}

impl Plan {
    /// Plans a frame.
    ///
    /// # Errors
    /// A setting out of range, too many lights, or a scene or picture that does not fit a buffer.
    pub fn new(
        scene: &SceneData,
        size: Size,
        settings: &RenderSettings,
        outputs: Outputs,
        room: Room,
    ) -> Result<Plan, PlanError> {
        settings.validate()?;
        let needs = scene.needs();
        let mut plan = Plan {
            size,
            settings: *settings,
            outputs,
            needs,
            scene_words: scene.words().len() as u32,
            triangles: scene.triangles(),
            slice_pixels: 1,
            path_room: 1,
            shadow_room: 1,
            undecided: room.undecided,
            buffer_bytes: room.buffer_bytes,
        };
        let shadow_rays = plan.light_samples();
        if shadow_rays > u64::from(MAX_SHADOW_RAYS) {
            return Err(PlanError::TooManyLights { rays: shadow_rays });
        }
        let most = |bytes: usize| (room.buffer_bytes / bytes as u64).min(1 << 30) as u32;
        let per_path = shadow_rays.max(1) as u32;
        // The list of rays on a device: its head, and the words of each.
        let words = DEFERRED_WORDS + if room.undecided { UNDECIDED_WORDS } else { 0 };
        let after_head = room.buffer_bytes.saturating_sub(4 * u64::from(DEFERRED_HEAD));
        let listed = (after_head / (4 * u64::from(words))).min(1 << 30) as u32;
        // A glass surface turns one ray into two. Twice the capacity is mostly enough; else the
        // frame is rendered again in smaller slices.
        let branching = if plan.branches() { 2 } else { 1 };
        // A small picture has as many paths per pixel as a large one.
        let least = if plan.branches() { LEAST_BRANCHING_ROOM } else { 1 };
        let pixels = settings.part.share(size.pixels()).len() as u32;
        let wanted = u64::from(pixels) * u64::from(settings.samples) * branching;
        let wanted = wanted.max(least);
        let paths = room
            .paths
            .min(most(Buffer::Surfaces.element_size()))
            .min(most(Buffer::ShadowRays.element_size()) / per_path)
            .min(listed / per_path)
            .min(wanted.min(1 << 30) as u32);
        let slice_paths = u64::from(paths) / branching;
        plan.slice_pixels = (slice_paths as u32 / settings.samples).clamp(1, pixels.max(1));
        plan.path_room = paths.max(plan.slice_pixels * settings.samples * branching as u32);
        plan.shadow_room = plan.path_room * per_path;
        for (what, buffer) in [
            ("scene's description", Buffer::Scene),
            ("picture", Buffer::Radiance),
            ("record of first hits", Buffer::FirstHits),
        ] {
            let needed = plan.bytes(buffer);
            if needed > room.buffer_bytes {
                return Err(PlanError::TooLarge { what, needed, allowed: room.buffer_bytes });
            }
        }
        Ok(plan)
    }

    /// The same frame in slices of half as many pixels, for when a queue outgrew its capacity;
    /// `None` when a slice is one pixel.
    #[must_use]
    pub fn halved(&self) -> Option<Plan> {
        (self.slice_pixels > 1)
            .then(|| Plan { slice_pixels: self.slice_pixels.div_ceil(2), ..*self })
    }

    /// The picture's size.
    pub fn size(&self) -> Size {
        self.size
    }

    /// The settings.
    pub fn settings(&self) -> &RenderSettings {
        &self.settings
    }

    /// The outputs to produce.
    pub fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// What the scene needs.
    pub fn needs(&self) -> &Needs {
        &self.needs
    }

    /// The pixels to make: those of [`RenderSettings::part`](crate::RenderSettings::part), counted row by row from the top left.
    pub fn pixels(&self) -> Range<u32> {
        self.settings.part.share(self.size.pixels())
    }

    /// Number of slices of those pixels, which are traced one at a time.
    pub fn slices(&self) -> u32 {
        (self.pixels().len() as u32).div_ceil(self.slice_pixels)
    }

    /// Most pixels of a slice.
    pub fn slice_pixels(&self) -> u32 {
        self.slice_pixels
    }

    /// Capacity for the paths of a wave.
    pub fn path_room(&self) -> u32 {
        self.path_room
    }

    /// Capacity for the shadow rays of a wave.
    pub fn shadow_room(&self) -> u32 {
        self.shadow_room
    }

    /// Most waves of a slice: camera rays, and one for each bounce.
    pub fn waves(&self) -> u32 {
        if self.recursive() { self.settings.depth + 1 } else { 1 }
    }

    /// Whether paths continue from surfaces.
    pub fn recursive(&self) -> bool {
        let scattered = match self.settings.light {
            LightTransport::Direct => false,
            LightTransport::Paths => true,
            LightTransport::Photons => self.gathers() || self.needs.emitters > 0,
        };
        let bounces = self.needs.mirrors || self.needs.dielectrics || scattered;
        self.outputs.shades() && bounces && self.settings.depth > 0
    }

    /// Whether a path may become two.
    fn branches(&self) -> bool {
        self.recursive() && self.needs.dielectrics && self.is_direct()
    }

    /// Whether surfaces ask for rays.
    pub fn spawns(&self) -> bool {
        self.recursive() || self.casts_shadows()
    }

    /// Samples of shining surfaces; 0 when nothing shines.
    pub fn area_samples(&self) -> u32 {
        if self.needs.emitters > 0 { self.settings.area_samples } else { 0 }
    }

    /// Whether light is not followed beyond direct light.
    pub fn is_direct(&self) -> bool {
        self.settings.light == LightTransport::Direct
    }

    /// Whether photons are looked up one bounce later.
    fn gathers(&self) -> bool {
        self.settings.light == LightTransport::Photons && self.settings.gather == Gather::Final
    }

    /// Samples of the environment for a surface point: 1 where light is followed beyond direct light and the environment shines; of a map in direct light
    /// as many as of surfaces that shine.
    pub fn sky_samples(&self) -> u32 {
        if self.needs.environment_map {
            return if self.is_direct() { self.settings.area_samples } else { 1 };
        }
        let environment = &self.settings.environment;
        let parts = [environment.zenith, environment.horizon, environment.nadir];
        let shines = parts.as_flattened().iter().any(|part| *part > 0.0);
        u32::from(shines && !self.is_direct())
    }

    /// Photons of a pass; 0 where no light is followed by them: none is wanted, nothing scatters it evenly or nothing shines.
    pub fn photons(&self) -> u32 {
        let wanted = self.settings.light == LightTransport::Photons && self.settings.depth > 0;
        let shines = self.needs.lights > 0 || self.needs.emitters > 0 || self.sky_samples() > 0;
        let stored = self.outputs.shades() && self.needs.diffuse;
        if wanted && shines && stored { self.settings.photons } else { 0 }
    }

    /// Most bytes of the photons that a pass stores, and of the tree of each map.
    pub(crate) fn buffer_bytes(&self) -> u64 {
        self.buffer_bytes
    }

    /// Samples of lights for a surface point.
    pub(crate) fn light_samples(&self) -> u64 {
        u64::from(self.needs.lights)
            + u64::from(self.area_samples())
            + u64::from(self.sky_samples())
    }

    /// Whether there are lights, and surfaces that they light.
    pub fn casts_shadows(&self) -> bool {
        let lit = self.needs.diffuse || (self.needs.rough && !self.is_direct());
        self.outputs.shades() && lit && self.light_samples() > 0
    }

    /// The same plan for a pass after the first: it records nothing of the first rays.
    #[must_use]
    pub(crate) fn repeated(&self) -> Plan {
        let outputs = Outputs { first_hits: false, first_costs: false, ..self.outputs };
        Plan { outputs, ..*self }
    }

    /// The kernel that follows shadow rays.
    pub fn shadow_kernel(&self) -> Kernel {
        if self.needs.dielectrics && self.is_direct() {
            Kernel::ShadowHitsThroughGlass
        } else {
            Kernel::ShadowHits
        }
    }

    /// The kernels of the frame, in the order of their first dispatch.
    pub fn kernels(&self) -> impl Iterator<Item = Kernel> + '_ {
        Kernel::ALL.into_iter().filter(|kernel| self.runs(*kernel))
    }

    fn runs(&self, kernel: Kernel) -> bool {
        match kernel {
            Kernel::BeginSlice | Kernel::CameraRays | Kernel::ClosestHits => true,
            Kernel::FirstCosts => self.outputs.first_costs,
            Kernel::FirstHits => self.outputs.first_hits,
            Kernel::Shade | Kernel::Accumulate => self.outputs.shades(),
            Kernel::ScanSpawned => self.spawns(),
            Kernel::ShadowRays => self.casts_shadows(),
            Kernel::ShadowHits | Kernel::ShadowHitsThroughGlass => {
                self.casts_shadows() && kernel == self.shadow_kernel()
            }
            Kernel::NextPaths | Kernel::BeginWave => self.recursive(),
            Kernel::Resolve => self.outputs.pixels,
        }
    }

    /// Elements of a buffer that the frame allocates: 0 for one that it does not need. A device binds
    /// one element of those too where a kernel names them.
    pub fn elements(&self, buffer: Buffer) -> u32 {
        let when = |needed: bool, elements: u32| if needed { elements } else { 0 };
        let pixels = self.size.pixels();
        match buffer {
            Buffer::Rays | Buffer::Paths | Buffer::Hits => self.path_room,
            Buffer::Surfaces => when(self.outputs.shades(), self.path_room),
            Buffer::Spawned => {
                when(self.outputs.shades(), self.path_room.div_ceil(crate::kernel::CHUNK))
            }
            Buffer::NextRays | Buffer::NextPaths => when(self.recursive(), self.path_room),
            Buffer::ShadowRays | Buffer::ShadowLight => {
                when(self.casts_shadows(), self.shadow_room)
            }
            Buffer::Scene => self.scene_words,
            Buffer::Radiance => when(self.outputs.shades(), pixels),
            Buffer::FirstHits => when(self.outputs.first_hits, pixels),
            Buffer::FirstCosts => when(self.outputs.first_costs, pixels),
            Buffer::Pixels => when(self.outputs.pixels, pixels),
            Buffer::Triangles => self.triangles,
            // These are the tree's; the frame does not determine how many there are.
            Buffer::Nodes
            | Buffer::LeafReferences
            | Buffer::CompressedNodes
            | Buffer::CompressedReferences => 0,
            Buffer::Deferred if self.undecided => {
                DEFERRED_HEAD
                    + (DEFERRED_WORDS + UNDECIDED_WORDS) * self.path_room.max(self.shadow_room)
            }
            Buffer::Deferred => {
                let shadows = when(self.casts_shadows(), self.shadow_room);
                DEFERRED_HEAD + DEFERRED_WORDS * self.path_room.max(shadows)
            }
            Buffer::Counters => 1,
        }
    }

    /// Bytes of a buffer that the frame allocates.
    pub fn bytes(&self, buffer: Buffer) -> u64 {
        u64::from(self.elements(buffer)) * buffer.element_size() as u64
    }

    /// The uniform of the frame.
    pub fn frame(&self, scene: &SceneData, camera: &Pinhole, query: &QueryOptions<'_>) -> Frame {
        let settings = &self.settings;
        let mut frame = Frame {
            eye: camera.eye,
            corner: camera.corner,
            width: self.size.width(),
            step_x: camera.step_x,
            height: self.size.height(),
            step_y: camera.step_y,
            samples: settings.samples,
            zenith: settings.environment.zenith,
            depth: if self.recursive() { settings.depth } else { 0 },
            horizon: settings.environment.horizon,
            area_samples: self.area_samples(),
            nadir: settings.environment.nadir,
            seed: settings.seed,
            // A path of weight 0 contributes nothing.
            minimum_weight: settings.minimum_weight.max(f32::MIN_POSITIVE),
            ambient: settings.ambient,
            headlight: settings.headlight,
            exposure: settings.exposure,
            sample_weight: 1.0 / (settings.samples as f32 * settings.passes as f32),
            transport: settings.light as u32 + u32::from(self.gathers()),
            sky_samples: self.sky_samples(),
            slice_pixels: self.slice_pixels,
            path_room: self.path_room,
            shadow_room: self.shadow_room,
            culling: match query.culling {
                Culling::None => 0,
                Culling::Back => 1,
                Culling::Front => 2,
            },
            ignore: query.ignore.unwrap_or(NONE),
            ..Frame::default()
        };
        scene.describe_to(&mut frame);
        #[cfg(test)]
        {
            frame.padding[9] = settings.planted.map_or(0, |fault| fault as u32);
        }
        frame
    }
}
