//! Materials to ours, by the rule stated at the top of the module.

use super::buffers::Buffers;
use super::uri::{self, Source};
use crate::angle::sin_cos;
use crate::from_file::{self, quoted};
use crate::instanced::InstancedScene;
use crate::obj::textures::Album;
use crate::{Material, SceneOptions};
use gltf_json::material::AlphaMode;
use gltf_json::validation::Checked;
use gltf_json::{Index, Root, Texture, image, material, texture};
use std::collections::HashMap;
use std::path::Path;

/// How a material reads texture coordinates.
pub(super) struct Wrap {
    /// The set of coordinates of a vertex.
    pub(super) set: u32,
    /// What is done with them: offset, sine and cosine of the turn, scale.
    offset: [f64; 2],
    turn: (f64, f64),
    scale: [f64; 2],
}

impl Wrap {
    fn of(info: &texture::Info) -> Wrap {
        let own = info.extensions.as_ref().and_then(|own| own.texture_transform.as_ref());
        let set = own.and_then(|own| own.tex_coord).unwrap_or(info.tex_coord);
        let offset = own.map_or([0.0; 2], |own| own.offset.0);
        let scale = own.map_or([1.0; 2], |own| own.scale.0);
        let turn = own.map_or(0.0, |own| f64::from(own.rotation.0) / std::f64::consts::TAU);
        let [offset, scale] = [offset, scale].map(|pair| pair.map(f64::from));
        Wrap { set, offset, turn: sin_cos(turn % 1.0), scale }
    }

    /// Coordinates as ours, which count from the lower edge of a picture.
    pub(super) fn apply(&self, own: [f32; 2]) -> [f32; 2] {
        let (sin, cos) = self.turn;
        let [u, v] = [0, 1].map(|axis| f64::from(own[axis]) * self.scale[axis]);
        let [u, v] = [cos * u + sin * v + self.offset[0], cos * v - sin * u + self.offset[1]];
        [u as f32, (1.0 - v) as f32]
    }
}

/// What meshes need to know of materials.
pub(super) struct Looks {
    /// For every material how it reads texture coordinates, if it does.
    pub(super) wraps: Vec<Option<Wrap>>,
}

/// What is lost of some materials.
#[derive(Default)]
struct Lost(Vec<(&'static str, u64, String)>);

impl Lost {
    fn add(&mut self, what: &'static str, name: &str) {
        match self.0.iter_mut().find(|(known, ..)| *known == what) {
            Some((_, count, _)) => *count += 1,
            None => self.0.push((what, 1, quoted(name))),
        }
    }
}

/// Reads all materials, which keep their numbers.
pub(super) fn read(
    root: &Root,
    buffers: &Buffers<'_>,
    scene: &mut InstancedScene,
    folder: &Path,
    options: &SceneOptions,
) -> Looks {
    let mut lost = Lost::default();
    let mut album = Album::new(options.texture_limit, options.decode_limit);
    let mut pictures: HashMap<usize, Option<u32>> = HashMap::new();
    let mut wraps = Vec::new();
    for (index, own) in root.materials.iter().enumerate() {
        let name = own.name.clone().unwrap_or_else(|| format!("material {index}"));
        let texture = own.pbr_metallic_roughness.base_color_texture.as_ref();
        let texture = texture.filter(|_| options.textures).and_then(|info| {
            let image = picture(root, info.index)?;
            let picture = *pictures.entry(image.value()).or_insert_with(|| {
                let shown = shown(&root.images[image.value()], image.value());
                match bytes(root, buffers, image, folder, options) {
                    Ok(bytes) => album.add_bytes(&name, &shown, bytes),
                    Err(why) => {
                        album.leave_out(&name, &shown, &why);
                        None
                    }
                }
            });
            Some((picture?, Wrap::of(info)))
        });
        let mut made = look(own, name, &mut lost);
        made.texture = texture.as_ref().map(|(picture, _)| *picture);
        scene.parts.materials.push(made);
        wraps.push(texture.map(|(_, wrap)| wrap));
    }
    let notes = &mut scene.parts.notes;
    notes.textures_over_limit += album.over_limit();
    let (textures, warnings) = album.finish();
    scene.parts.textures = textures;
    notes.warnings.extend(warnings);
    for (what, count, first) in lost.0 {
        notes.warnings.push(format!("{count} materials {what}, the first is `{first}`"));
    }
    Looks { wraps }
}

/// The picture of a texture.
fn picture(root: &Root, index: Index<Texture>) -> Option<Index<image::Image>> {
    let source = root.textures.get(index.value())?.source;
    // Some textures have pictures of other extensions only.
    (source.value() < root.images.len()).then_some(source)
}

/// A name for messages.
fn shown(image: &image::Image, index: usize) -> String {
    let uri = image.uri.clone().filter(|uri| !uri.starts_with("data:"));
    uri.or_else(|| image.name.clone()).unwrap_or_else(|| format!("image {index}"))
}

fn bytes(
    root: &Root,
    buffers: &Buffers<'_>,
    index: Index<image::Image>,
    folder: &Path,
    options: &SceneOptions,
) -> Result<Vec<u8>, String> {
    let image = &root.images[index.value()];
    match (&image.uri, image.buffer_view) {
        (Some(uri), _) => match uri::resolve(uri, folder)? {
            Source::Bytes(bytes) => Ok(bytes),
            Source::File(path) => {
                // Pictures are smaller in their files than decoded, or not worth decoding.
                from_file::read(&path, options.decode_limit).map_err(|error| error.to_string())
            }
        },
        (None, Some(view)) => match buffers.view(view) {
            Ok(bytes) => Ok(bytes.to_vec()),
            Err((_, problem)) => Err(problem.to_string()),
        },
        (None, None) => Err("it has no bytes".to_owned()),
    }
}

/// The material without its texture.
fn look(own: &material::Material, name: String, lost: &mut Lost) -> Material {
    let pbr = &own.pbr_metallic_roughness;
    let [red, green, blue, alpha] = pbr.base_color_factor.0;
    let base = [red, green, blue];
    let (metallic, roughness) = (pbr.metallic_factor.0, pbr.roughness_factor.0);
    let more = own.extensions.as_ref();
    for (has, what) in [
        (own.normal_texture.is_some(), "have a texture of normals, which is left out"),
        (own.occlusion_texture.is_some(), "have a texture of occlusion, which is left out"),
        (
            pbr.metallic_roughness_texture.is_some(),
            "have a texture of metal and roughness, which is left out: they scatter light evenly",
        ),
        (
            own.emissive_texture.is_some() && own.emissive_factor.0 != [0.0; 3],
            "have a texture of emission and do not shine",
        ),
        (
            matches!(own.alpha_mode, Checked::Valid(AlphaMode::Mask)),
            "have holes by their textures' alpha, which are closed",
        ),
    ] {
        if has {
            lost.add(what, &name);
        }
    }
    let transmission = more.and_then(|more| more.transmission.as_ref());
    let transmission = transmission.map_or(0.0, |own| own.transmission_factor.0);
    let is_body = more.and_then(|more| more.volume.as_ref());
    let is_body = is_body.is_some_and(|own| own.thickness_factor.0 > 0.0);
    let index = more.and_then(|more| more.ior.as_ref()).map_or(1.5, |own| own.ior.0);
    let is_blended = matches!(own.alpha_mode, Checked::Valid(AlphaMode::Blend));
    let mut made = Material::new(name, base);
    if transmission >= 0.5 {
        if transmission < 1.0 {
            lost.add(
                "scatter a part of the light that they transmit, which is left out",
                &made.name,
            );
        }
        made = made.with_dielectric(if is_body { index } else { 1.0 }, base);
        made = made.with_roughness(roughness);
    } else if is_blended && alpha < 0.5 {
        let tint = base.map(|part| (1.0 - alpha) + alpha * part);
        made = made.with_dielectric(1.0, tint);
    } else {
        if transmission > 0.0 || (is_blended && alpha < 1.0) {
            lost.add("are more opaque than clear and are drawn opaque", &made.name);
        }
        let is_known = pbr.metallic_roughness_texture.is_none();
        if is_known && metallic >= 0.5 && roughness < 0.5 {
            let scattered = base.map(|part| part * (1.0 - metallic));
            made =
                Material::new(made.name, scattered).with_mirror(base.map(|part| part * metallic));
            made = made.with_roughness(roughness);
        }
    }
    let strength = more.and_then(|more| more.emissive_strength.as_ref());
    let strength = strength.map_or(1.0, |own| own.emissive_strength.0);
    if own.emissive_texture.is_none() {
        made = made.with_emission(own.emissive_factor.0.map(|part| part * strength));
    }
    made
}
