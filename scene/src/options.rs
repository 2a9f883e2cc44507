//! How files become scenes.

/// How files become scenes. Built-in scenes do not depend on it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneOptions {
    /// Which surfaces are mirrors.
    pub materials: MaterialRule,
    /// Whether the textures that materials name are read.
    pub textures: bool,
    /// Whether the pictures of `map_d`, which say where surfaces have holes, are read: see [`Scene::cutouts`](crate::Scene::cutouts). Scene files of
    /// many objects read them in any case.
    pub cutouts: bool,
    /// Whether instances that a scene file bakes become one mesh, which is for rays; else they stay instances.
    pub bake: bool,
    /// Most bytes that are held while a scene file of many objects is read: its text, its entries, what they become, .obj files after the first (links and copies of
    /// one too) and their texts, parts of files that are named again, opacity masks, and what it bakes. A small file can ask for very much; more is an error that names the
    /// place with which it is too much, before memory is taken for it. Lists count by their capacity, and twice while they grow. A string of more than 4,096 bytes counts 32 times
    /// while the text is read, since an error may quote it.
    ///
    /// Not among them are the first .obj file (see `file_limit`), .mtl files (64 MiB each, 256 MiB of one .obj file) and pictures (see `texture_limit` and `decode_limit`), nor
    /// what the system's allocator adds to each piece of memory; besides, up to 160 KiB are held. `None` is half of the machine's memory, and 16 GiB where that is not known.
    pub memory_limit: Option<u64>,
    /// Most bytes that the texels of all textures together may take, four a texel. Textures are
    /// halved, the largest first, until they fit.
    pub texture_limit: u64,
    /// Most additional bytes that decoding one texture may take; the header of its file says how
    /// many it will. All textures of a scene together may decode to [`SceneOptions::DECODES`] times
    /// as many. A texture past either is left out, with a note.
    pub decode_limit: u64,
    /// Most bytes of a file that is read whole; `None` is half of the machine's memory, and 16 GiB where
    /// that is not known.
    pub file_limit: Option<u64>,
}

impl SceneOptions {
    /// Texels of 96 MiB: with the rest of a scene's tables they fit in one buffer of 128 MiB, the
    /// most that every GPU can bind.
    pub const TEXTURE_LIMIT: u64 = 96 << 20;

    /// 512 MiB for one texture: 13,000 x 13,000 texels of 8-bit colour, or 16,384 x 16,384 of grey.
    pub const DECODE_LIMIT: u64 = 512 << 20;

    /// How many times the limit of one texture all textures together may decode to, one at a time:
    /// 8 GiB by default.
    pub const DECODES: u64 = 16;
}

impl Default for SceneOptions {
    fn default() -> SceneOptions {
        SceneOptions {
            materials: MaterialRule::default(),
            textures: true,
            cutouts: false,
            bake: true,
            memory_limit: None,
            texture_limit: SceneOptions::TEXTURE_LIMIT,
            decode_limit: SceneOptions::DECODE_LIMIT,
            file_limit: None,
        }
    }
}

/// What the materials of an .mtl file become.
///
/// The first that applies:
///
/// 1. **Clear**: `illum` 4, 6, 7 or 9, or `d` of 1/2 and less (`Tr` of 1/2 and more), is the boundary
///    of a clear body of refractive index `Ni`; where that is 1 or missing, light goes straight
///    through. By `illum` its tint is `Tf`, by `d` it is `(1 - d) Tf + d Kd`: what could not be
///    scattered goes through; without `Tf`, white stands for it. Two exceptions: an `illum` that asks
///    for refraction says nothing where `Ni` is 1, `Tf` white and `d` 1, since some programs write
///    that for every opaque surface; and a surface of which more is opaque than clear is opaque.
/// 2. **Mirror and diffuse**: `illum` 3, 5 or 8 scatters `Kd` and mirrors `Ks`, alike at all angles.
/// 3. **Mirror**: where `Kd` is black and there is no texture, the colour of a mirror or metal is all
///    in `Ks`, which is mirrored.
/// 4. **Diffuse**: everything else scatters `Kd`, times the texture `map_Kd`.
///
/// Mirrors and clear bodies are rough by `Pr`, from 0 to 1. Without it `Ns` says how rough they are, as Phong's exponent: the roughness is
/// `(2 / (Ns + 2))^(1/4)`, whose square is the width of slopes (Walter et al. 2007); but where `illum` is 3 to 9, rays are traced as from a smooth
/// surface and `Ns` says nothing.
///
/// `Ke` shines whatever else applies. `d` counts where both `d` and `Tr` are given. A black or
/// missing `Kd` under a texture is white, else the texture could not be seen. Where mirrored and
/// scattered light together would be more than comes in, less is scattered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum MaterialRule {
    /// As above: `Ks` is a mirror only where `illum` says so, since most files give every surface a
    /// `Ks`, for highlights.
    #[default]
    Illum,
    /// Every `Ks` above 0.05 in some channel is mirrored, whatever `illum` says: rule 2 for all that
    /// is not clear. What scenes made for ray tracers mean by it.
    Specular,
}
