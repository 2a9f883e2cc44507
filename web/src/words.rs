//! Arrays in the module's memory, which JavaScript sees through views of its own.

use wasm_bindgen::prelude::*;

use crate::failure::Failure;

/// Words of 32 bits: floats, integers or bytes, as the view says.
#[wasm_bindgen]
pub struct Words(Vec<u32>);

#[wasm_bindgen]
impl Words {
    /// So many words, all 0.
    #[wasm_bindgen(constructor)]
    pub fn new(length: u32) -> Result<Words, JsValue> {
        Ok(Words(zeros(length as usize)?))
    }

    /// Where they are in the module's memory.
    pub fn pointer(&self) -> usize {
        self.0.as_ptr() as usize
    }

    /// How many.
    pub fn length(&self) -> usize {
        self.0.len()
    }
}

impl Words {
    pub(crate) fn of(words: Vec<u32>) -> Words {
        Words(words)
    }

    /// As elements of `N` words each.
    pub(crate) fn rows<const N: usize>(&self, what: &str) -> Result<&[[u32; N]], Failure> {
        let (rows, rest) = self.0.as_chunks();
        match rest.is_empty() {
            true => Ok(rows),
            false => Err(Failure::length(what, self.0.len(), N)),
        }
    }

    /// Points, or corners of triangles.
    pub(crate) fn points(&self, what: &str) -> Result<&[[f32; 3]], Failure> {
        Ok(bytemuck::cast_slice(self.rows::<3>(what)?))
    }

    #[cfg(any(feature = "page", not(feature = "gpu")))]
    pub(crate) fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }

    /// Some elements of `T`, from the one of number `first` on.
    pub(crate) fn part<T: bytemuck::Pod>(
        &self,
        what: &str,
        first: u32,
        count: u32,
    ) -> Result<&[T], Failure> {
        let all: &[T] = bytemuck::try_cast_slice(&self.0)
            .map_err(|_| Failure::length(what, self.0.len(), size_of::<T>() / 4))?;
        let length = all.len();
        let end = (first as usize).checked_add(count as usize);
        end.and_then(|end| all.get(first as usize..end))
            .ok_or_else(|| Failure::range(what, first, count, length))
    }

    /// The same to be written.
    #[cfg(not(any(feature = "gpu", feature = "page")))]
    pub(crate) fn part_mut<T: bytemuck::Pod>(
        &mut self,
        what: &str,
        first: u32,
        count: u32,
    ) -> Result<&mut [T], Failure> {
        let words = self.0.len();
        let all: &mut [T] = bytemuck::try_cast_slice_mut(&mut self.0)
            .map_err(|_| Failure::length(what, words, size_of::<T>() / 4))?;
        let length = all.len();
        let end = (first as usize).checked_add(count as usize);
        end.and_then(|end| all.get_mut(first as usize..end))
            .ok_or_else(|| Failure::range(what, first, count, length))
    }
}

/// Zeros, or an error where there is no memory for them.
pub(crate) fn zeros<T: Clone + Default>(length: usize) -> Result<Vec<T>, Failure> {
    let mut all = Vec::new();
    all.try_reserve_exact(length).map_err(|_| Failure::memory(length * size_of::<T>()))?;
    all.resize(length, T::default());
    Ok(all)
}
