//! The records that kernels exchange: plain, packed, the same bytes on every executor.

use bytemuck::{Pod, Zeroable};

/// A path: where its light goes and how much of it. 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Path {
    /// Part of the light at its end that reaches the eye, by colour.
    pub weight: [f32; 3],
    /// Its pixel, counted from the top left, row by row.
    pub pixel: u32,
    /// Which sample of the pixel it belongs to.
    pub sequence: u32,
    /// Probability density by solid angle with which its direction was chosen, where light is followed beyond
    /// direct light; 0 where the direction could be no other, and from the camera.
    pub density: f32,
    /// The density with which a sample of the environment would have chosen that direction.
    pub sky_density: f32,
    /// What it met before, where photons are looked up: 0 nothing but mirrors and clear bodies, 1 a surface that scattered it evenly, and
    /// nothing since, 2 a mirror or clear body since, 3 photons, so that it sees lights alone. Of a photon: 0 nothing, 1 only mirrors and clear
    /// bodies, 2 a surface that scattered it evenly.
    pub history: u32,
}

/// The surface at the point that a path's ray met. 80 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Surface {
    /// The point.
    pub point: [f32; 3],
    /// How far off the triangle a new ray must start, so that it does not meet it.
    pub offset: f32,
    /// Unit normal of the triangle, on the side that the ray came from.
    pub geometric_normal: [f32; 3],
    /// Index of the material.
    pub material: u32,
    /// Unit normal for shading, on the same side.
    pub normal: [f32; 3],
    /// Bit `l` set: light sample `l` may light the surface.
    pub lights: u32,
    /// Part of the light that is scattered evenly. Of a dielectric: Fresnel reflectance, cosine of
    /// the refracted ray, and index on the ray's side over index behind.
    pub scattering: [f32; 3],
    /// [`Surface::REFLECTS`] and the others.
    pub flags: u32,
    /// Light that comes from here without further rays, times the path's weight.
    pub light: [f32; 3],
    /// Direction towards where the path came from, in two halves of 16 bits; only where light is followed beyond
    /// direct light.
    pub incoming: u32,
}

impl Surface {
    /// A reflected ray continues.
    pub const REFLECTS: u32 = 1;
    /// A refracted ray continues.
    pub const REFRACTS: u32 = 2;
    /// The driver of a device did not follow the ray to its end.
    pub const UNFINISHED: u32 = 4;
    /// Photons that came straight from lights through mirrors and clear bodies bring it light.
    pub const CAUSTICS: u32 = 8;
    /// Photons that other surfaces scattered bring it light.
    pub const GLOBAL: u32 = 16;

    /// Shadow rays that it asks for.
    pub const fn shadow_rays(&self) -> u32 {
        self.lights.count_ones()
    }

    /// Paths that continue from it.
    pub const fn next_paths(&self) -> u32 {
        (self.flags & (Surface::REFLECTS | Surface::REFRACTS)).count_ones()
    }
}

/// Rays that a chunk of paths asks for; after the scan, those of all chunks before it. 8 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Spawned {
    /// Shadow rays.
    pub shadow_rays: u32,
    /// Paths of the next wave.
    pub next_paths: u32,
}

/// The hit of the first ray of a pixel. 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct FirstHit {
    /// Unit normal of the triangle, on the side of the eye; zero for a miss.
    pub normal: [f32; 3],
    /// Distance along the ray; infinity for a miss.
    pub depth: f32,
    /// Index of the triangle; `u32::MAX` for a miss.
    pub triangle: u32,
    /// Barycentric weight of the second corner.
    pub u: f32,
    /// Barycentric weight of the third corner.
    pub v: f32,
    /// The instance; 0 in one mesh, and for a miss.
    pub instance: u32,
}

impl FirstHit {
    /// The record of a pixel whose ray meets nothing.
    pub const MISS: FirstHit = FirstHit {
        normal: [0.0; 3],
        depth: f32::INFINITY,
        triangle: u32::MAX,
        u: 0.0,
        v: 0.0,
        instance: 0,
    };
}

/// The cost of a ray's traversal. 8 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct FirstCost {
    /// Nodes visited.
    pub nodes: u32,
    /// Triangles tested.
    pub triangles: u32,
}

/// All counters, by [`Counter`](crate::kernel::Counter). 64 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Counters {
    /// The words.
    pub words: [u32; 16],
}

/// The uniform of a frame, which every kernel reads. 256 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Frame {
    /// Where camera rays start.
    pub eye: [f32; 3],
    /// Always 0. Shaders take their opaque zero from here, which no compiler can see through.
    pub zero: u32,
    /// Direction through the top left corner of the picture.
    pub corner: [f32; 3],
    /// Pixels from left to right.
    pub width: u32,
    /// The change of direction from a pixel to the one to its right.
    pub step_x: [f32; 3],
    /// Pixels from top to bottom.
    pub height: u32,
    /// The change of direction from a pixel to the one below.
    pub step_y: [f32; 3],
    /// Camera rays per pixel.
    pub samples: u32,
    /// [`Environment::zenith`](crate::Environment::zenith).
    pub zenith: [f32; 3],
    /// Greatest number of bounces.
    pub depth: u32,
    /// [`Environment::horizon`](crate::Environment::horizon).
    pub horizon: [f32; 3],
    /// Samples of shining surfaces.
    pub area_samples: u32,
    /// [`Environment::nadir`](crate::Environment::nadir).
    pub nadir: [f32; 3],
    /// Seed of the samples.
    pub seed: u32,
    /// Least weight of a path that continues.
    pub minimum_weight: f32,
    /// Part of the environment's light that surfaces receive.
    pub ambient: f32,
    /// The light of the headlight that a white surface sends back.
    pub headlight: f32,
    /// Exposure: the factor before display.
    pub exposure: f32,
    /// 1 over the number of samples.
    pub sample_weight: f32,
    /// Most pixels of a slice.
    pub slice_pixels: u32,
    /// Capacity for paths.
    pub path_room: u32,
    /// Capacity for shadow rays.
    pub shadow_room: u32,
    /// Lights without a size.
    pub lights: u32,
    /// Triangles that shine.
    pub emitters: u32,
    /// Number of materials.
    pub materials: u32,
    /// Number of triangles.
    pub triangles: u32,
    /// Where the lights start in the words of the scene. Materials start at 0.
    pub lights_at: u32,
    /// Where the shining triangles start.
    pub emitters_at: u32,
    /// Where the textures start.
    pub textures_at: u32,
    /// Where the tables of sRGB start: 256 linear values of bytes, then 256 least linear values.
    pub srgb_at: u32,
    /// Where the materials of the triangles start.
    pub material_of_at: u32,
    /// Where the normals start.
    pub normals_at: u32,
    /// Where the texture coordinates start.
    pub texcoords_at: u32,
    /// Where the texels start.
    pub texels_at: u32,
    /// Which side of a triangle rays ignore: 0 none, 1 the back, 2 the front. Read by devices.
    pub culling: u32,
    /// The triangle that rays ignore; [`scene_data::NONE`](crate::scene_data::NONE) for none. Read by devices.
    pub ignore: u32,
    /// Where the corners of the triangles stand that one binding does not hold. Read by devices.
    pub tail_at: u32,
    /// How light travels: [`LightTransport`](crate::LightTransport) as a number.
    pub transport: u32,
    /// The first sample of a pixel in this pass.
    pub first_sequence: u32,
    /// Samples of the environment for every surface point: 0 or 1.
    pub sky_samples: u32,
    /// Not used: fills 256 bytes.
    pub padding: [u32; 10],
}

const _: () = assert!(size_of::<Path>() == 32 && size_of::<Surface>() == 80);
const _: () = assert!(size_of::<FirstHit>() == 32 && size_of::<Frame>() == 256);
