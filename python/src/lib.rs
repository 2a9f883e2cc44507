//! The part of the Python package that is compiled: the library's calls on arrays whose dtypes, shapes and strides the
//! Python part has brought into one form. Nothing here trusts that: whatever comes is checked again.

mod answers;
mod arrays;
mod built;
mod call;
mod edits;
mod failure;
mod ignored;
mod named;
mod open;
mod options;
mod order;
mod parts;
mod points;
mod pool;
mod rays;
mod scene;
mod tree;
mod unit;
mod volumes;

use pyo3::prelude::*;

/// The module `splitplane._native`.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<tree::Tree>()?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<points::PointTree>()?;
    module.add_function(wrap_pyfunction!(named::named, module)?)?;
    module.add_function(wrap_pyfunction!(named::cast_named, module)?)?;
    module.add_function(wrap_pyfunction!(unit::unit_rays, module)?)?;
    module.add_function(wrap_pyfunction!(volumes::overlaps, module)?)?;
    module.add_function(wrap_pyfunction!(volumes::overlaps_any, module)?)?;
    module.add_function(wrap_pyfunction!(volumes::impacts, module)?)?;
    module.add_function(wrap_pyfunction!(volumes::scene_overlaps, module)?)?;
    module.add_function(wrap_pyfunction!(volumes::scene_overlaps_any, module)?)?;
    module.add_function(wrap_pyfunction!(parts::add_shapes, module)?)?;
    module.add_function(wrap_pyfunction!(parts::replace_shapes, module)?)?;
    module.add_function(wrap_pyfunction!(parts::kind_of, module)?)?;
    module.add_function(wrap_pyfunction!(parts::set_opacity, module)?)?;
    module.add_function(wrap_pyfunction!(parts::opacity, module)?)?;
    module.add_function(wrap_pyfunction!(parts::opacity_cells, module)?)?;
    module.add_function(wrap_pyfunction!(open::describe, module)?)?;
    module.add_function(wrap_pyfunction!(options::choose_preset, module)?)?;
    module.add_function(wrap_pyfunction!(open::mesh_digest, module)?)?;
    module.add("VERSION", env!("CARGO_PKG_VERSION"))?;
    module.add("GPU", cfg!(feature = "wgpu"))?;
    Ok(())
}
