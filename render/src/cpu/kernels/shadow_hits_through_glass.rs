//! Removes the light of shadow rays that hit something opaque; clear surfaces only tint it. Light
//! goes straight through them: no lens gathers it.

use crate::cpu::buffers::Buffers;
use crate::cpu::traced::Traced;
use crate::scene_data::DIELECTRIC;
use crate::scene_words::SceneWords;
use crate::surface::{MOST_CLEAR_LAYERS, after};
use crate::vector::{greatest, mul};
use crate::world::{Spot, World};
use splitplane_core::error::QueryError;
use splitplane_core::ray::{Hit, QueryOptions};

pub(crate) fn run(
    traced: Traced<'_>,
    options: &QueryOptions<'_>,
    scene: &SceneWords<'_>,
    world: impl World,
    count: usize,
    buffers: &mut Buffers,
) -> Result<(), QueryError> {
    let Buffers { shadow_rays, shadow_light, through_rays, through_indices, through_hits, .. } =
        buffers;
    let (scene_hits, instances) = (&mut buffers.scene_hits, &mut buffers.through_instances);
    through_rays.clear();
    through_rays.extend_from_slice(&shadow_rays[..count]);
    through_indices.clear();
    through_indices.extend(0..count as u32);
    for layer in 0..=MOST_CLEAR_LAYERS {
        through_hits.clear();
        through_hits.resize(through_rays.len(), Hit::MISS);
        traced.closest_hits(
            through_rays,
            through_hits,
            (&mut *scene_hits, &mut *instances),
            options,
        )?;
        let mut kept = 0;
        for i in 0..through_rays.len() {
            let (hit, index) = (through_hits[i], through_indices[i]);
            if !hit.is_hit() {
                continue;
            }
            let light = &mut shadow_light[index as usize];
            let instance = instances.get(i).copied().unwrap_or(0);
            let material = world.material(scene, Spot { triangle: hit.triangle, instance });
            if layer == MOST_CLEAR_LAYERS || scene.material_kind(material) != DIELECTRIC {
                *light = [0.0; 4];
                continue;
            }
            let tint = scene.second_colour(material);
            let [r, g, b] = mul([light[0], light[1], light[2]], tint);
            *light = [r, g, b, 0.0];
            if greatest([r, g, b]) > 0.0 {
                through_rays[kept] =
                    through_rays[i].with_limits(after(hit.t), through_rays[i].t_max);
                through_indices[kept] = index;
                kept += 1;
            }
        }
        if kept == 0 {
            break;
        }
        through_rays.truncate(kept);
        through_indices.truncate(kept);
    }
    Ok(())
}
