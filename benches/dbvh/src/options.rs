//! The command line.

use splitplane::render::Size;
use splitplane::report::asked::{Asked, STAND_INS};
use std::path::PathBuf;

/// What is asked for.
#[derive(Clone, Debug)]
pub(crate) struct Options {
    pub(crate) size: Size,
    pub(crate) repeat: usize,
    pub(crate) threads: usize,
    /// Standard output when left out.
    pub(crate) output: Option<PathBuf>,
    pub(crate) scenes: Vec<Asked>,
}

impl Options {
    pub(crate) fn parse(arguments: impl IntoIterator<Item = String>) -> Result<Options, String> {
        let mut options = Options {
            size: size("1024x1024")?,
            repeat: 5,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            output: None,
            scenes: Vec::new(),
        };
        let mut arguments = arguments.into_iter();
        while let Some(argument) = arguments.next() {
            let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
            match argument.as_str() {
                "--size" => options.size = size(&value()?)?,
                "--repeat" => {
                    let number = value()?.parse().ok().filter(|n| n % 2 == 1);
                    options.repeat = number.ok_or("--repeat needs an odd number")?;
                }
                "--threads" => {
                    let number = value()?.parse().ok().filter(|n| (1..=1024).contains(n));
                    options.threads = number.ok_or("--threads needs a number from 1 to 1024")?;
                }
                "-o" => options.output = Some(value()?.into()),
                option if option.starts_with('-') => {
                    return Err(format!("there is no option {option}"));
                }
                scene => options.scenes.push(parse(scene)?),
            }
        }
        if options.scenes.is_empty() {
            options.scenes = STAND_INS.into_iter().map(parse).collect::<Result<_, _>>()?;
        }
        Ok(options)
    }
}

fn parse(text: &str) -> Result<Asked, String> {
    text.parse().map_err(|error: splitplane::report::asked::BadLights| error.to_string())
}

fn size(text: &str) -> Result<Size, String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    let (width, height) = sides.ok_or("--size needs pixels, such as 1024x1024")?;
    Size::new(width, height).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(words: &[&str]) -> Result<Options, String> {
        Options::parse(words.iter().map(|word| word.to_string()))
    }

    #[test]
    fn defaults_are_those_of_the_report() {
        let options = parse(&[]).unwrap();
        assert_eq!((options.scenes.len(), options.repeat), (STAND_INS.len(), 5));
        assert_eq!((options.size.width(), options.size.height()), (1024, 1024));
    }

    #[test]
    fn what_is_wrong_is_said() {
        let options = parse(&["a.obj@2", "--size", "64x48", "--repeat", "3", "-o", "x"]).unwrap();
        assert_eq!((options.scenes[0].lights, options.size.height()), (Some(2), 48));
        for bad in
            [&["--size"][..], &["--size", "4"], &["--repeat", "2"], &["--threads", "0"], &["--x"]]
        {
            assert!(parse(bad).is_err(), "{bad:?}");
        }
    }
}
