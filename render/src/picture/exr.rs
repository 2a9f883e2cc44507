//! Linear pictures: OpenEXR.

use super::{Aov, FirstCost, FirstHit, PictureError, Size};
use ::exr::block::chunk::Chunk;
use ::exr::block::lines::LineRefMut;
use ::exr::block::writer::ChunksWriter;
use ::exr::block::{self, BlockIndex, UncompressedBlock};
use ::exr::compression::Compression;
use ::exr::error::{Result as ExrResult, UnitResult};
use ::exr::math::Vec2;
use ::exr::meta::attribute::{ChannelDescription, Chromaticities, LineOrder, SampleType, Text};
use ::exr::meta::header::{Header, LayerAttributes};
use ::exr::meta::{BlockDescription, Headers};
use rayon::prelude::*;
use std::io::{Seek, Write};

/// Blocks of 16 rows that are compressed before they are written: enough for every core, and a small part
/// of a large picture.
const BATCH: usize = 64;

/// The bytes of an OpenEXR file with one layer, `R`, `G` and `B` as 32-bit floats: linear radiance
/// for the primaries and the white of ITU-R BT.709. Every bit is kept, also of infinities and NaN.
///
/// Output variables become further channels, under the names that compositors look for:
///
/// | variable | channels | samples | a ray that meets nothing |
/// |---|---|---|---|
/// | [`Aov::Depth`] | `Z`, the distance along the ray | 32-bit float | infinity |
/// | [`Aov::Normal`] | `N.X`, `N.Y`, `N.Z`, in the scene's axes | 32-bit float | 0, 0, 0 |
/// | [`Aov::Triangle`] | `triangle` | 32-bit unsigned integer | 4294967295 |
/// | [`Aov::Instance`] | `instance` | 32-bit unsigned integer | 4294967295 |
/// | [`Aov::Nodes`] | `nodes` | 32-bit unsigned integer | as for others |
/// | [`Aov::Tests`] | `tests` | 32-bit unsigned integer | as for others |
///
/// Compression is ZIP in blocks of 16 rows, which loses nothing. Blocks are compressed on the current
/// rayon pool; the bytes do not depend on its size.
///
/// # Errors
/// [`PictureError::Length`]: an array without one value a pixel. [`PictureError::Repeated`]: a variable
/// twice. [`PictureError::Encode`]: the encoder refuses.
pub fn encode_exr(
    size: Size,
    radiance: &[[f32; 4]],
    aovs: &[Aov<'_>],
) -> Result<Vec<u8>, PictureError> {
    PictureError::check_length("the array of radiance", radiance.len(), size)?;
    for (place, aov) in aovs.iter().enumerate() {
        aov.check(size)?;
        if aovs[..place].iter().any(|other| other.name() == aov.name()) {
            return Err(PictureError::Repeated(aov.name()));
        }
    }
    let channels = channels(radiance, aovs);
    let mut file = std::io::Cursor::new(Vec::new());
    write(&mut file, size, &channels).map_err(PictureError::exr)?;
    Ok(file.into_inner())
}

/// A channel of a file: where its samples come from.
#[derive(Clone, Copy)]
enum Channel<'a> {
    Radiance(usize, &'a [[f32; 4]]),
    Depth(&'a [FirstHit]),
    Normal(usize, &'a [FirstHit]),
    Triangle(&'a [FirstHit]),
    Instance(&'a [FirstHit]),
    Nodes(&'a [FirstCost]),
    Tests(&'a [FirstCost]),
}

impl Channel<'_> {
    fn name(&self) -> &'static str {
        match *self {
            Channel::Radiance(component, _) => ["R", "G", "B"][component],
            Channel::Depth(_) => "Z",
            Channel::Normal(axis, _) => ["N.X", "N.Y", "N.Z"][axis],
            Channel::Triangle(_) => "triangle",
            Channel::Instance(_) => "instance",
            Channel::Nodes(_) => "nodes",
            Channel::Tests(_) => "tests",
        }
    }

    fn description(&self) -> ChannelDescription {
        let samples = match self {
            Channel::Radiance(..) | Channel::Depth(_) | Channel::Normal(..) => SampleType::F32,
            Channel::Triangle(_) | Channel::Instance(_) | Channel::Nodes(_) | Channel::Tests(_) => {
                SampleType::U32
            }
        };
        ChannelDescription::named(self.name(), samples)
    }

    /// Writes the samples of a line whose left pixel is `first`.
    fn write(&self, line: LineRefMut<'_>, first: usize) -> UnitResult {
        match *self {
            Channel::Radiance(component, all) => line.write_samples(|x| all[first + x][component]),
            Channel::Depth(hits) => line.write_samples(|x| hits[first + x].depth),
            Channel::Normal(axis, hits) => line.write_samples(|x| hits[first + x].normal[axis]),
            Channel::Triangle(hits) => line.write_samples(|x| hits[first + x].triangle),
            Channel::Instance(hits) => line.write_samples(|x| {
                let hit = &hits[first + x];
                if hit.triangle == FirstHit::MISS.triangle { u32::MAX } else { hit.instance }
            }),
            Channel::Nodes(costs) => line.write_samples(|x| costs[first + x].nodes),
            Channel::Tests(costs) => line.write_samples(|x| costs[first + x].triangles),
        }
    }
}

/// All channels of a file, by name, as the format wants them.
fn channels<'a>(radiance: &'a [[f32; 4]], aovs: &[Aov<'a>]) -> Vec<Channel<'a>> {
    let mut channels: Vec<Channel<'a>> = (0..3).map(|i| Channel::Radiance(i, radiance)).collect();
    for aov in aovs {
        match *aov {
            Aov::Depth(hits) => channels.push(Channel::Depth(hits)),
            Aov::Normal(hits) => channels.extend((0..3).map(|axis| Channel::Normal(axis, hits))),
            Aov::Triangle(hits) => channels.push(Channel::Triangle(hits)),
            Aov::Instance(hits) => channels.push(Channel::Instance(hits)),
            Aov::Nodes(costs) => channels.push(Channel::Nodes(costs)),
            Aov::Tests(costs) => channels.push(Channel::Tests(costs)),
        }
    }
    channels.sort_unstable_by_key(Channel::name);
    channels
}

fn header(size: Size, channels: &[Channel<'_>]) -> Header {
    let descriptions = channels.iter().map(Channel::description).collect();
    let pixels = (size.width() as usize, size.height() as usize);
    let mut header = Header::new(Text::from("splitplane"), pixels, descriptions).with_encoding(
        Compression::ZIP16,
        BlockDescription::ScanLines,
        LineOrder::Increasing,
    );
    // Without a layer's name, compositors show the channels under their own.
    header.own_attributes = LayerAttributes {
        layer_name: None,
        software_name: Some(Text::from("splitplane")),
        ..LayerAttributes::default()
    };
    header.shared_attributes.chromaticities = Some(Chromaticities {
        red: Vec2(0.64, 0.33),
        green: Vec2(0.30, 0.60),
        blue: Vec2(0.15, 0.06),
        white: Vec2(0.3127, 0.3290),
    });
    header
}

fn write(file: impl Write + Seek, size: Size, channels: &[Channel<'_>]) -> UnitResult {
    let headers = Headers::from_iter([header(size, channels)]);
    let width = size.width() as usize;
    block::write(file, headers, true, |meta, writer| {
        let blocks: Vec<(usize, BlockIndex)> =
            block::enumerate_ordered_header_block_indices(&meta.headers).collect();
        let compress = |&(_, index): &(usize, BlockIndex)| -> ExrResult<Chunk> {
            let mut outcome = Ok(());
            let list = &meta.headers[index.layer].channels;
            let block = UncompressedBlock::from_lines(list, index, |line| {
                let Vec2(x, y) = line.location.position;
                let written = channels[line.location.channel].write(line, y * width + x);
                if outcome.is_ok() {
                    outcome = written;
                }
            });
            outcome?;
            block.compress_to_chunk(&meta.headers)
        };
        // In order, batch by batch: equal pictures give equal bytes.
        for batch in blocks.chunks(BATCH) {
            let chunks: Vec<ExrResult<Chunk>> = batch.par_iter().map(compress).collect();
            for (&(place, _), chunk) in batch.iter().zip(chunks) {
                writer.write_chunk(place, chunk?)?;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::exr::prelude::{FlatSamples, ReadChannels, ReadLayers};

    /// The samples of a channel, floats as their bits.
    fn read(bytes: &[u8], name: &str) -> (SampleType, Vec<u32>) {
        let file = ::exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_buffered(std::io::Cursor::new(bytes))
            .unwrap();
        let list = file.layer_data.channel_data.list;
        let channel = list.into_iter().find(|channel| channel.name.eq(name)).unwrap();
        match channel.sample_data {
            FlatSamples::F32(values) => {
                (SampleType::F32, values.into_iter().map(f32::to_bits).collect())
            }
            FlatSamples::U32(values) => (SampleType::U32, values),
            FlatSamples::F16(_) => panic!("no channel has half floats"),
        }
    }

    fn names(bytes: &[u8]) -> Vec<String> {
        let meta = ::exr::meta::MetaData::read_from_buffered(std::io::Cursor::new(bytes), true);
        let list = meta.unwrap().headers[0].channels.list.clone();
        list.iter().map(|channel| channel.name.to_string()).collect()
    }

    /// A picture with every kind of value, odd in size and with more rows than a block.
    fn sample() -> (Size, Vec<[f32; 4]>, Vec<FirstHit>, Vec<FirstCost>) {
        let size = Size::new(7, 37).unwrap();
        let odd = [f32::NAN, f32::INFINITY, -f32::INFINITY, -0.0, 1e-42, 1e30, -3.5];
        let at = |i: u32| odd.get(i as usize).copied().unwrap_or(i as f32 * 0.37);
        let radiance = (0..size.pixels()).map(|i| [at(i), at(i + 1), at(i + 2), 0.0]).collect();
        let hits = (0..size.pixels()).map(|i| match i % 5 {
            0 => FirstHit::MISS,
            1 => FirstHit { triangle: u32::MAX - 1, ..FirstHit::MISS },
            _ => FirstHit {
                normal: [at(i), -at(i + 2), at(i + 3)],
                depth: at(i),
                triangle: i.wrapping_mul(0x9e37_79b9),
                ..FirstHit::MISS
            },
        });
        let costs = (0..size.pixels()).map(|i| FirstCost { nodes: u32::MAX - i, triangles: i * i });
        (size, radiance, hits.collect(), costs.collect())
    }

    #[test]
    fn every_channel_comes_back_bit_for_bit() {
        let (size, radiance, hits, costs) = sample();
        let aovs = [
            Aov::Tests(&costs),
            Aov::Depth(&hits),
            Aov::Triangle(&hits),
            Aov::Normal(&hits),
            Aov::Nodes(&costs),
        ];
        let bytes = encode_exr(size, &radiance, &aovs).unwrap();
        let expected = ["B", "G", "N.X", "N.Y", "N.Z", "R", "Z", "nodes", "tests", "triangle"];
        assert_eq!(names(&bytes), expected);
        let float = |name: &str, value: &dyn Fn(usize) -> f32| {
            let bits = (0..radiance.len()).map(|i| value(i).to_bits()).collect();
            assert_eq!(read(&bytes, name), (SampleType::F32, bits), "{name}");
        };
        for (component, name) in ["R", "G", "B"].into_iter().enumerate() {
            float(name, &|i| radiance[i][component]);
        }
        for (axis, name) in ["N.X", "N.Y", "N.Z"].into_iter().enumerate() {
            float(name, &|i| hits[i].normal[axis]);
        }
        float("Z", &|i| hits[i].depth);
        let integer = |name: &str, value: &dyn Fn(usize) -> u32| {
            let values = (0..radiance.len()).map(value).collect();
            assert_eq!(read(&bytes, name), (SampleType::U32, values), "{name}");
        };
        integer("triangle", &|i| hits[i].triangle);
        integer("nodes", &|i| costs[i].nodes);
        integer("tests", &|i| costs[i].triangles);
    }

    #[test]
    fn the_crate_image_reads_the_same_pixels() {
        let (size, radiance, hits, _) = sample();
        for aovs in [&[][..], &[Aov::Depth(&hits), Aov::Triangle(&hits)]] {
            let bytes = encode_exr(size, &radiance, aovs).unwrap();
            let read = image::load_from_memory_with_format(&bytes, image::ImageFormat::OpenExr);
            let read = read.unwrap().into_rgb32f();
            assert_eq!(read.dimensions(), (size.width(), size.height()));
            for (pixel, expected) in read.pixels().zip(&radiance) {
                assert_eq!(pixel.0.map(f32::to_bits), [0, 1, 2].map(|i| expected[i].to_bits()));
            }
        }
    }

    #[test]
    fn one_pixel_is_a_picture() {
        let bytes = encode_exr(Size::new(1, 1).unwrap(), &[[0.25, 0.5, 4.0, 0.0]], &[]).unwrap();
        assert_eq!(names(&bytes), ["B", "G", "R"]);
        assert_eq!(read(&bytes, "B").1, [4.0_f32.to_bits()]);
    }

    #[test]
    fn the_header_says_how_it_is_meant() {
        let (size, radiance, ..) = sample();
        let bytes = encode_exr(size, &radiance, &[]).unwrap();
        let meta = ::exr::meta::MetaData::read_from_buffered(std::io::Cursor::new(&bytes), true);
        let header = meta.unwrap().headers.remove(0);
        assert_eq!(header.compression, Compression::ZIP16);
        assert_eq!(header.own_attributes.layer_name, None);
        assert_eq!(header.shared_attributes.chromaticities.unwrap().white, Vec2(0.3127, 0.3290));
        assert_eq!(header.shared_attributes.pixel_aspect, 1.0);
    }

    #[test]
    fn bytes_do_not_depend_on_the_number_of_threads() {
        // More blocks than a batch.
        let size = Size::new(3, 16 * (BATCH as u32 + 6)).unwrap();
        let radiance: Vec<[f32; 4]> = (0..size.pixels()).map(|i| [i as f32; 4]).collect();
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| encode_exr(size, &radiance, &[]).unwrap())
        };
        assert_eq!(with(1), with(3));
        let last = read(&with(2), "R").1;
        assert_eq!(last.last(), Some(&((size.pixels() - 1) as f32).to_bits()));
    }

    #[test]
    fn wrong_lengths_and_repeated_variables_are_errors() {
        let (size, radiance, hits, costs) = sample();
        let error = encode_exr(size, &radiance[1..], &[]).unwrap_err();
        assert!(matches!(error, PictureError::Length { found: 258, .. }), "{error}");
        let error = encode_exr(size, &radiance, &[Aov::Nodes(&costs[..3])]).unwrap_err();
        assert!(matches!(error, PictureError::Length { found: 3, .. }), "{error}");
        let twice = [Aov::Depth(&hits), Aov::Normal(&hits), Aov::Depth(&hits)];
        let error = encode_exr(size, &radiance, &twice).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the channel `depth` is asked for twice; a file can have it once"
        );
    }
}
