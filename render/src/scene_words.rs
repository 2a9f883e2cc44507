//! Reads a scene's appearance from its words. Twin of `scene_words.wgsl`.

use crate::environment_map::EnvironmentMap;
use crate::layout::Frame;
use crate::scene_data::{EMITTER_WORDS, LIGHT_WORDS, MATERIAL_WORDS, NONE, TEXTURE_WORDS};
use crate::vector::{Vector, add, mix, scaled};

/// The words and where their sections start.
#[derive(Clone, Copy)]
pub(crate) struct SceneWords<'a> {
    pub(crate) words: &'a [u32],
    pub(crate) frame: &'a Frame,
    /// In place of the frame's own environment; on the CPU alone.
    pub(crate) environment: Option<&'a EnvironmentMap>,
}

/// A material, without the texture's colour.
pub(crate) struct MaterialWords {
    pub(crate) kind: u32,
    pub(crate) texture: u32,
    pub(crate) refractive_index: f32,
    pub(crate) diffuse: Vector,
    /// Reflectance of a mirror, or tint of a dielectric.
    pub(crate) second: Vector,
    pub(crate) emission: Vector,
}

/// What a material does with light that comes from anywhere.
pub(crate) struct ScatteringWords {
    pub(crate) kind: u32,
    /// Reflectance of a mirror, or tint of a dielectric.
    pub(crate) second: Vector,
    /// The width of its distribution of slopes.
    pub(crate) alpha: f32,
}

/// A light without a size.
pub(crate) struct LightWords {
    pub(crate) kind: u32,
    /// Position, or unit direction towards it.
    pub(crate) place: Vector,
    pub(crate) irradiance: Vector,
    pub(crate) distance: f32,
}

/// A triangle that shines.
pub(crate) struct EmitterWords {
    pub(crate) triangle: u32,
    pub(crate) probability: f32,
    /// The instance that it is of; 0 in one mesh.
    pub(crate) instance: u32,
}

impl SceneWords<'_> {
    fn word(&self, at: u32) -> u32 {
        self.words[at as usize]
    }

    fn float(&self, at: u32) -> f32 {
        f32::from_bits(self.word(at))
    }

    fn vector(&self, at: u32) -> Vector {
        vector_of(self.words_at::<3>(at), 0)
    }

    /// Some words from a place on: their bounds are checked once.
    fn words_at<const N: usize>(&self, at: u32) -> &[u32; N] {
        self.words[at as usize..].first_chunk().expect("sections are whole")
    }

    pub(crate) fn material_of(&self, triangle: u32) -> u32 {
        self.word(self.frame.material_of_at + triangle)
    }

    pub(crate) fn material(&self, index: u32) -> MaterialWords {
        let words = self.words_at::<{ MATERIAL_WORDS as usize }>(MATERIAL_WORDS * index);
        MaterialWords {
            kind: words[0],
            texture: words[1],
            refractive_index: f32::from_bits(words[2]),
            diffuse: vector_of(words, 4),
            second: vector_of(words, 8),
            emission: vector_of(words, 12),
        }
    }

    pub(crate) fn scattering(&self, material: u32) -> ScatteringWords {
        let at = MATERIAL_WORDS * material;
        ScatteringWords {
            kind: self.word(at),
            second: self.vector(at + 8),
            alpha: self.float(at + 11),
        }
    }

    /// Reflectance of a mirror, or tint of a dielectric.
    pub(crate) fn second_colour(&self, material: u32) -> Vector {
        self.vector(MATERIAL_WORDS * material + 8)
    }

    pub(crate) fn material_kind(&self, material: u32) -> u32 {
        self.word(MATERIAL_WORDS * material)
    }

    pub(crate) fn light(&self, index: u32) -> LightWords {
        let at = self.frame.lights_at + LIGHT_WORDS * index;
        let words = self.words_at::<{ LIGHT_WORDS as usize }>(at);
        LightWords {
            kind: words[0],
            place: vector_of(words, 1),
            irradiance: vector_of(words, 4),
            distance: f32::from_bits(words[7]),
        }
    }

    /// The triangle that shines whose share of 2^32 holds this word.
    pub(crate) fn emitter(&self, random: u32) -> EmitterWords {
        // The first whose greatest word is not below; the last one's is 2^32 - 1.
        let (mut low, mut high) = (0, self.frame.emitters - 1);
        while low < high {
            let middle = (low + high) / 2;
            if self.word(self.frame.emitters_at + EMITTER_WORDS * middle + 1) >= random {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        let at = self.frame.emitters_at + EMITTER_WORDS * low;
        EmitterWords {
            triangle: self.word(at),
            probability: self.float(at + 2),
            instance: self.word(at + 3),
        }
    }

    /// The probability of a triangle that shines among all; 0 for one that does not.
    pub(crate) fn emitter_probability(&self, triangle: u32, instance: u32) -> f32 {
        // They stand in the order of instances and triangles.
        let place = |index: u32| {
            let at = self.frame.emitters_at + EMITTER_WORDS * index;
            (self.word(at + 3), self.word(at))
        };
        let (mut low, mut high) = (0, self.frame.emitters);
        while low < high {
            let middle = (low + high) / 2;
            if place(middle) < (instance, triangle) {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        if low < self.frame.emitters && place(low) == (instance, triangle) {
            self.float(self.frame.emitters_at + EMITTER_WORDS * low + 2)
        } else {
            0.0
        }
    }

    /// The normal at a corner; zero for none.
    pub(crate) fn normal(&self, triangle: u32, corner: u32) -> Vector {
        self.vector(self.frame.normals_at + 9 * triangle + 3 * corner)
    }

    /// The normals at all three corners.
    pub(crate) fn corner_normals(&self, triangle: u32) -> [Vector; 3] {
        let words = self.words_at::<9>(self.frame.normals_at + 9 * triangle);
        [0, 3, 6].map(|at| vector_of(words, at))
    }

    /// Whether there are normals at corners: the section of a scene without any is empty.
    pub(crate) fn has_normals(&self) -> bool {
        self.frame.normals_at != self.frame.texcoords_at
    }

    fn texcoord(&self, triangle: u32, corner: u32) -> [f32; 2] {
        let at = self.frame.texcoords_at + 6 * triangle + 2 * corner;
        [self.float(at), self.float(at + 1)]
    }

    /// The colour of a texture at a point of a triangle: four texels, weighted by nearness. White for
    /// no texture, and for shapes.
    pub(crate) fn texture_colour(&self, texture: u32, triangle: u32, weights: [f32; 3]) -> Vector {
        if texture == NONE || triangle == NONE {
            return [1.0; 3];
        }
        let corners = [0, 1, 2].map(|corner| self.texcoord(triangle, corner));
        let [s, t] = [0, 1].map(|axis| {
            (corners[0][axis] * weights[0] + corners[1][axis] * weights[1])
                + corners[2][axis] * weights[2]
        });
        let at = self.frame.textures_at + TEXTURE_WORDS * texture;
        let (first, width, height) = (self.word(at), self.word(at + 1), self.word(at + 2));
        // Rows run downwards, and texel centres are at halves.
        let (left, right, across) = texel_pair(s, width);
        let (upper, lower, down) = texel_pair(1.0 - t, height);
        let row = |row: u32| {
            let start = first + row * width;
            mix(self.texel(start + left), self.texel(start + right), across)
        };
        mix(row(upper), row(lower), down)
    }

    /// The linear colour of a texel.
    fn texel(&self, index: u32) -> Vector {
        let word = self.word(self.frame.texels_at + index);
        [0, 8, 16].map(|shift| self.float(self.frame.srgb_at + ((word >> shift) & 255)))
    }

    /// The byte that shows a linear value: the last whose least value it reaches.
    pub(crate) fn shown(&self, value: f32) -> u32 {
        let least = self.words_at::<256>(self.frame.srgb_at + 256);
        let mut byte = 0;
        for bit in [128, 64, 32, 16, 8, 4, 2, 1] {
            if value >= f32::from_bits(least[(byte + bit) as usize & 255]) {
                byte += bit;
            }
        }
        byte
    }
}

/// Three of some words.
fn vector_of(words: &[u32], at: usize) -> Vector {
    [f32::from_bits(words[at]), f32::from_bits(words[at + 1]), f32::from_bits(words[at + 2])]
}

/// The two texels on either side of a coordinate that repeats after 1, and the part of the second.
fn texel_pair(coordinate: f32, size: u32) -> (u32, u32, f32) {
    // A coordinate that repeats too often to be resolved has no place in the picture.
    let within = if coordinate.abs() < 4_194_304.0 { coordinate - coordinate.floor() } else { 0.0 };
    let place = within * size as f32 - 0.5;
    let before = place.floor();
    let index = before as i32;
    let last = size as i32 - 1;
    let left = if index < 0 { last } else { index.min(last) };
    let right = if left == last { 0 } else { left + 1 };
    (left as u32, right as u32, place - before)
}

/// A point between corners: `a * w0 + b * w1 + c * w2`.
#[inline]
pub(crate) fn weighted(corners: [Vector; 3], weights: [f32; 3]) -> Vector {
    let [a, b, c] = corners;
    add(add(scaled(a, weights[0]), scaled(b, weights[1])), scaled(c, weights[2]))
}
