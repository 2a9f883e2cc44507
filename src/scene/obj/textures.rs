//! Textures of materials: each file decoded once, all of them within a limit of memory.

use super::library::find;
use super::reader::told;
use crate::scene::Texture;
use image::{ImageReader, Limits};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Greatest side of a picture that is decoded, in texels.
const MAX_SIDE: u32 = 16_384;
/// Most bytes that decoding one picture may take.
const MAX_DECODED: u64 = 512 << 20;
/// Greatest file that is opened, in bytes.
const MAX_FILE: u64 = 512 << 20;

/// The textures of a scene under construction.
pub(super) struct Album {
    limit: u64,
    textures: Vec<Texture>,
    /// What every file became, `None` for one that cannot be read.
    by_file: HashMap<PathBuf, Option<u32>>,
    halved: Vec<bool>,
    warnings: Vec<String>,
}

impl Album {
    /// At most `limit` bytes of texels.
    pub(super) fn new(limit: u64) -> Album {
        Album {
            limit,
            textures: Vec::new(),
            by_file: HashMap::new(),
            halved: Vec::new(),
            warnings: Vec::new(),
        }
    }

    /// The texture that a material names. What stands in the way is a warning.
    pub(super) fn add(&mut self, material: &str, folder: &Path, name: &str) -> Option<u32> {
        let found = find(folder, name).or_else(|| {
            // Many files name a place on their author's disk.
            let bare = name.rsplit(['/', '\\']).next().filter(|bare| *bare != name)?;
            find(folder, bare)
        });
        let Some(path) = found else {
            self.warn(material, name, "there is no such file");
            return None;
        };
        let key = path.canonicalize().unwrap_or_else(|_| path.clone());
        if let Some(known) = self.by_file.get(&key) {
            return *known;
        }
        let texture = match decode(&path, name) {
            Ok(texture) => {
                self.textures.push(texture);
                self.halved.push(false);
                self.fit();
                Some(self.textures.len() as u32 - 1)
            }
            Err(why) => {
                self.warn(material, name, &why);
                None
            }
        };
        self.by_file.insert(key, texture);
        texture
    }

    /// The textures, and what is to be said of them.
    pub(super) fn finish(mut self) -> (Vec<Texture>, Vec<String>) {
        let count = self.halved.iter().filter(|halved| **halved).count();
        if count > 0 {
            self.warnings.push(format!(
                "{count} textures are smaller than in their files, to keep all of them within {} MiB",
                self.limit >> 20
            ));
        }
        (self.textures, self.warnings)
    }

    fn warn(&mut self, material: &str, name: &str, why: &str) {
        // What decoders say may end in a line feed.
        let (name, material, why) = (told(name), told(material), told(why.trim()));
        self.warnings
            .push(format!("the texture `{name}` of material `{material}` is left out: {why}"));
    }

    /// Halves the largest texture until all fit, or nothing is left to halve.
    fn fit(&mut self) {
        let bytes = |texture: &Texture| 4 * texture.texels().len() as u64;
        while self.textures.iter().map(bytes).sum::<u64>() > self.limit {
            let sizes = self.textures.iter().map(|texture| texture.texels().len());
            // The first of the largest.
            let largest = sizes.enumerate().max_by_key(|&(i, size)| (size, std::cmp::Reverse(i)));
            let Some((i, 2..)) = largest else { break };
            let Some(smaller) = halve(&self.textures[i]) else { break };
            self.textures[i] = smaller;
            self.halved[i] = true;
        }
    }
}

fn decode(path: &Path, name: &str) -> Result<Texture, String> {
    let about = path.metadata().map_err(|error| error.to_string())?;
    if about.len() > MAX_FILE {
        return Err(format!("the file is larger than {} MiB", MAX_FILE >> 20));
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_DECODED);
    // By its contents; formats without a mark of their own by the ending.
    let mut reader = ImageReader::open(path)
        .and_then(ImageReader::with_guessed_format)
        .map_err(|error| error.to_string())?;
    reader.limits(limits);
    let picture = reader.decode().map_err(|error| error.to_string())?.into_rgba8();
    let (width, height) = picture.dimensions();
    let (texels, _) = picture.as_raw().as_chunks::<4>();
    Texture::new(name, width, height, texels.to_vec()).ok_or_else(|| "it is empty".to_owned())
}

/// The same picture at half the size, every texel the mean of up to four.
fn halve(texture: &Texture) -> Option<Texture> {
    let [width, height] = [texture.width(), texture.height()].map(|side| side as usize);
    let [half_width, half_height] = [width, height].map(|side| (side / 2).max(1));
    let mut texels = Vec::with_capacity(half_width * half_height);
    for y in 0..half_height {
        for x in 0..half_width {
            let (right, below) = ((2 * x + 1).min(width - 1), (2 * y + 1).min(height - 1));
            let four = [(2 * x, 2 * y), (right, 2 * y), (2 * x, below), (right, below)];
            let four = four.map(|(x, y)| texture.texels()[y * width + x]);
            texels.push(std::array::from_fn(|channel| {
                let sum: u32 = four.iter().map(|texel| u32::from(texel[channel])).sum();
                ((sum + 2) / 4) as u8
            }));
        }
    }
    Texture::new(texture.name(), half_width as u32, half_height as u32, texels)
}
