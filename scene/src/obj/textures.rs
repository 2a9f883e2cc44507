//! Textures of materials: each file decoded once, all of them within limits of memory and work.

use super::named_file::find;
use super::said::Said;
use crate::from_file::{self, Identity, quoted, quoted_reason};
use crate::{SceneOptions, Texture};
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::borrow::Cow;
use std::collections::HashMap;
use std::io::{BufRead, BufReader, Cursor, Seek, SeekFrom};
use std::path::Path;
use thiserror::Error;

/// Greatest side of a picture that is decoded, in texels: some rows of it in colour are held beside it.
const MAX_SIDE: u32 = 65_536;

/// The textures of a scene under construction.
pub(crate) struct Album {
    limit: u64,
    decode_limit: u64,
    /// Bytes that may be decoded yet.
    left: u64,
    textures: Vec<Texture>,
    /// What every file became, `None` for one that cannot be read.
    by_file: HashMap<Identity, Option<u32>>,
    halved: Vec<bool>,
    /// Files left out because decoding one takes too much.
    over_limit: u64,
    said: Said,
}

impl Album {
    /// At most `limit` bytes of texels, and as many again as [`SceneOptions::decode_limit`] says while
    /// they are decoded.
    pub(crate) fn new(limit: u64, decode_limit: u64) -> Album {
        Album {
            limit,
            decode_limit,
            left: decode_limit.saturating_mul(SceneOptions::DECODES),
            textures: Vec::new(),
            by_file: HashMap::new(),
            halved: Vec::new(),
            over_limit: 0,
            said: Said::default(),
        }
    }

    /// The texture that a material names. Obstacles become warnings.
    pub(super) fn add(&mut self, material: &str, folder: &Path, name: &str) -> Option<u32> {
        let found = find(folder, name).or_else(|| {
            // Many files name a place on their author's disk.
            let bare = name.rsplit(['/', '\\']).next().filter(|bare| *bare != name)?;
            find(folder, bare)
        });
        let file = found.and_then(|path| Some((Identity::of(&path).ok()?, path)));
        let Some((file, path)) = file else {
            self.warn(material, name, "there is no such file");
            return None;
        };
        if let Some(known) = self.by_file.get(&file) {
            return *known;
        }
        let texture = match self.read(&path, name) {
            Ok(texture) => Some(texture),
            Err(why) => {
                self.over_limit += u64::from(matches!(why, Refusal::OverLimit { .. }));
                self.warn(material, name, &why.to_string());
                None
            }
        };
        self.by_file.insert(file, texture);
        texture
    }

    /// The texture that bytes hold, named for messages. Obstacles become warnings. Equal bytes are not looked for.
    #[cfg(feature = "gltf")]
    pub(crate) fn add_bytes(&mut self, material: &str, name: &str, bytes: Vec<u8>) -> Option<u32> {
        let picture = Picture::of_bytes(bytes, self.decode_limit);
        match picture.and_then(|picture| self.keep(picture, name)) {
            Ok(texture) => Some(texture),
            Err(why) => {
                self.over_limit += u64::from(matches!(why, Refusal::OverLimit { .. }));
                self.warn(material, name, &why.to_string());
                None
            }
        }
    }

    /// Says that a texture is left out for a reason of the caller's.
    #[cfg(feature = "gltf")]
    pub(crate) fn leave_out(&mut self, material: &str, name: &str, why: &str) {
        self.warn(material, name, why);
    }

    /// How many files were left out because decoding them takes more than [`SceneOptions::decode_limit`].
    pub(crate) fn over_limit(&self) -> u64 {
        self.over_limit
    }

    /// The textures, and the notes on them.
    pub(crate) fn finish(self) -> (Vec<Texture>, Vec<String>) {
        let mut said = self.said.sentences();
        let count = self.halved.iter().filter(|halved| **halved).count();
        if count > 0 {
            said.push(format!(
                "{count} textures are smaller than in their files, to keep all of them within {} MiB",
                self.limit >> 20
            ));
        }
        (self.textures, said)
    }

    fn warn(&mut self, material: &str, name: &str, why: &str) {
        self.said.say(|| {
            let (name, material, why) = (quoted(name), quoted(material), quoted_reason(why));
            format!("the texture `{name}` of material `{material}` is left out: {why}")
        });
    }

    /// Decodes a file at the size that fits, and halves those before it where necessary.
    fn read(&mut self, path: &Path, name: &str) -> Result<u32, Refusal> {
        self.keep(Picture::open(path, self.decode_limit)?, name)
    }

    fn keep(&mut self, picture: Picture, name: &str) -> Result<u32, Refusal> {
        let decoded = picture.decoder.total_bytes();
        if decoded > self.left {
            return Err(Refusal::Other(format!(
                "with it, more than {} MiB would be decoded for all textures together",
                self.decode_limit.saturating_mul(SceneOptions::DECODES) >> 20
            )));
        }
        let (width, height) = picture.decoder.dimensions();
        let sizes = self.textures.iter().map(|texture| [texture.width(), texture.height()]);
        let levels = fit(sizes.chain([[width, height]]).collect(), self.limit);
        // Whether or not it can be decoded, it is tried.
        self.left -= decoded;
        let place = self.textures.len();
        let level = levels.last().copied().unwrap_or(0);
        self.textures.push(picture.decode(name, level)?);
        self.halved.push(level > 0);
        for (i, level) in levels.into_iter().enumerate().take(place) {
            for _ in 0..level {
                self.textures[i] = halve(&self.textures[i]).ok_or("it is empty".to_owned())?;
                self.halved[i] = true;
            }
        }
        Ok(place as u32)
    }
}

/// How often each texture of these sizes must be halved until all fit, or nothing is left to halve:
/// always the largest.
fn fit(mut sizes: Vec<[u32; 2]>, limit: u64) -> Vec<u32> {
    let texels = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
    let mut levels = vec![0; sizes.len()];
    let mut sum: u64 = sizes.iter().map(|size| texels(*size)).sum();
    while sum > limit / 4 {
        let all = sizes.iter().map(|size| texels(*size)).enumerate();
        // The first of the largest.
        let largest = all.max_by_key(|&(i, size)| (size, std::cmp::Reverse(i)));
        let Some((i, size @ 2..)) = largest else { break };
        sizes[i] = sizes[i].map(|side| (side / 2).max(1));
        levels[i] += 1;
        sum -= size - texels(sizes[i]);
    }
    levels
}

/// Why a texture is left out.
#[derive(Debug, Error)]
enum Refusal {
    /// Decoding it takes more bytes than one texture may take.
    #[error("decoding it takes {needed} bytes, but {limit} are the most that one texture may take")]
    OverLimit { needed: u64, limit: u64 },
    /// Anything else, in words.
    #[error("{0}")]
    Other(String),
}

impl From<String> for Refusal {
    fn from(why: String) -> Refusal {
        Refusal::Other(why)
    }
}

/// What pictures are decoded from.
trait Source: BufRead + Seek {}

impl<T: BufRead + Seek> Source for T {}

/// A picture of which only the header was read.
struct Picture {
    decoder: Box<dyn ImageDecoder>,
    /// Bytes that decoding takes.
    needed: u64,
}

impl Picture {
    fn open(path: &Path, limit: u64) -> Result<Picture, Refusal> {
        let (mut file, length) =
            from_file::open_regular(path).map_err(|error| error.to_string())?;
        // By its contents; formats without a mark of their own by the ending.
        let mut format = ImageFormat::from_path(path).ok();
        let guess = ImageReader::new(BufReader::new(&mut file)).with_guessed_format();
        format = guess.map_err(|error| error.to_string())?.format().or(format);
        file.seek(SeekFrom::Start(0)).map_err(|error| error.to_string())?;
        if format == Some(ImageFormat::Jpeg) {
            let mut bytes = Vec::new();
            from_file::fill(file, length, limit / 2, &mut bytes)
                .map_err(|_| Refusal::OverLimit { needed: length.saturating_mul(2), limit })?;
            return Picture::of_jpeg(bytes, limit);
        }
        Picture::of_source(Box::new(BufReader::new(file)), format, 0, 1, limit)
    }

    /// A picture that is in memory already.
    #[cfg(feature = "gltf")]
    fn of_bytes(bytes: Vec<u8>, limit: u64) -> Result<Picture, Refusal> {
        let guess = ImageReader::new(Cursor::new(&bytes)).with_guessed_format();
        let format = guess.map_err(|error| error.to_string())?.format();
        match format {
            Some(ImageFormat::Jpeg) => Picture::of_jpeg(bytes, limit),
            _ => Picture::of_source(Box::new(Cursor::new(bytes)), format, 0, 1, limit),
        }
    }

    fn of_jpeg(bytes: Vec<u8>, limit: u64) -> Result<Picture, Refusal> {
        // Its decoder holds them a second time, and may hold all coefficients.
        let held = 2 * bytes.len() as u64;
        let times = if is_progressive(&bytes) { 4 } else { 1 };
        let format = Some(ImageFormat::Jpeg);
        Picture::of_source(Box::new(Cursor::new(bytes)), format, held, times, limit)
    }

    /// A picture whose decoder holds this many bytes, and some times as many as it gives.
    fn of_source(
        source: Box<dyn Source>,
        format: Option<ImageFormat>,
        held: u64,
        times: u64,
        limit: u64,
    ) -> Result<Picture, Refusal> {
        let mut limits = Limits::default();
        limits.max_image_width = Some(MAX_SIDE);
        limits.max_image_height = Some(MAX_SIDE);
        limits.max_alloc = Some(limit);
        // Which features others ask of the decoders' crate decides nothing here.
        if let Some(ImageFormat::Hdr | ImageFormat::OpenExr) = format {
            return Err("pictures of linear light are no textures".to_owned().into());
        }
        let mut reader = ImageReader::new(source);
        if let Some(format) = format {
            reader.set_format(format);
        }
        reader.limits(limits);
        let decoder = reader.into_decoder().map_err(|error| error.to_string())?;
        let needed = decoder.total_bytes().saturating_mul(times).saturating_add(held);
        if needed > limit {
            return Err(Refusal::OverLimit { needed, limit });
        }
        Ok(Picture { decoder: Box::new(decoder), needed })
    }

    /// The picture, halved this many times. Apart from the decoder's output, the whole picture
    /// never exists at full size.
    fn decode(self, name: &str, level: u32) -> Result<Texture, String> {
        let memory = |bytes: u64| {
            let bytes = usize::try_from(bytes).ok()?;
            Vec::<u8>::new().try_reserve_exact(bytes).ok()
        };
        // Decoders end the program where there is none.
        memory(self.needed).ok_or("there is not memory enough")?;
        let picture =
            DynamicImage::from_decoder(self.decoder).map_err(|error| error.to_string())?;
        let (width, height) = (picture.width(), picture.height());
        if width == 0 || height == 0 {
            return Err("it is empty".to_owned());
        }
        // The rows that become one; none of them is left over but at the end.
        let rows = 1u32.checked_shl(level).unwrap_or(u32::MAX).min(height);
        let [half_width, half_height] =
            [width, height].map(|side| side.checked_shr(level).unwrap_or(0).max(1));
        let count = half_width as usize * half_height as usize;
        let mut texels: Vec<[u8; 4]> = Vec::new();
        texels.try_reserve_exact(count).map_err(|_| "there is not memory enough")?;
        // Many rows at a time: what is done once a part should not matter.
        let together = rows.saturating_mul((256 / rows).max(1));
        for top in (0..height).step_by(together as usize) {
            let part = picture.crop_imm(0, top, width, together.min(height - top)).into_rgba8();
            // Less than what becomes one row is left over.
            if part.height() < rows {
                break;
            }
            let mut sides = [part.width(), part.height()];
            let (colours, _) = part.as_raw().as_chunks::<4>();
            let mut smaller = Cow::Borrowed(colours);
            for _ in 0..level {
                smaller = halved(&smaller, &mut sides).into();
            }
            texels.extend_from_slice(&smaller);
        }
        Texture::new(name, half_width, half_height, texels).ok_or_else(|| "it is empty".to_owned())
    }
}

/// Whether a JPEG gives its picture in passes. Decoders hold the coefficients of all of it then.
fn is_progressive(bytes: &[u8]) -> bool {
    let mut at = 2;
    while let Some(&[0xff, mark, high, low]) = bytes.get(at..at + 4).and_then(<[u8]>::first_chunk) {
        match mark {
            // Start of a frame: progressive ones, whatever else they are.
            0xc2 | 0xc6 | 0xca | 0xce => return true,
            0xc0 | 0xc1 | 0xc3 | 0xda => return false,
            // What fills up, and marks without a length.
            0xff => at += 1,
            0x01 | 0xd0..=0xd8 => at += 2,
            _ => at += 2 + usize::from(u16::from_be_bytes([high, low])),
        }
    }
    // Not understood: the more memory is counted.
    true
}

/// The same picture at half the size.
fn halve(texture: &Texture) -> Option<Texture> {
    let mut sides = [texture.width(), texture.height()];
    let texels = halved(texture.texels(), &mut sides);
    Texture::new(texture.name(), sides[0], sides[1], texels)
}

/// Texels at half the size, every one the mean of up to four; `sides` become those of the result.
fn halved(texels: &[[u8; 4]], sides: &mut [u32; 2]) -> Vec<[u8; 4]> {
    let [width, height] = sides.map(|side| side as usize);
    *sides = sides.map(|side| (side / 2).max(1));
    let [half_width, half_height] = sides.map(|side| side as usize);
    let mut half = Vec::with_capacity(half_width * half_height);
    for y in 0..half_height {
        for x in 0..half_width {
            let (right, below) = ((2 * x + 1).min(width - 1), (2 * y + 1).min(height - 1));
            let four = [(2 * x, 2 * y), (right, 2 * y), (2 * x, below), (right, below)];
            let four = four.map(|(x, y)| texels[y * width + x]);
            half.push(std::array::from_fn(|channel| {
                let sum: u32 = four.iter().map(|texel| u32::from(texel[channel])).sum();
                ((sum + 2) / 4) as u8
            }));
        }
    }
    half
}
