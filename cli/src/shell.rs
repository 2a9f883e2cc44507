//! What a shell and `man` know of the program, made from its own description.

use super::failure::Failure;
use super::{Cli, files, output};
use clap::{Args, CommandFactory};
use clap_complete::Shell;
use clap_mangen::Man;
use std::path::PathBuf;

#[derive(Args, Debug)]
pub(super) struct Completions {
    /// The shell
    shell: Shell,
}

/// Prints the completions of a shell.
pub(super) fn completions(arguments: &Completions) -> Result<(), Failure> {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut Cli::command(), "splitplane", &mut text);
    output::data(&String::from_utf8_lossy(&text))
}

#[derive(Args, Debug)]
pub(super) struct ManPages {
    /// The folder to write them to; it must be there
    folder: PathBuf,
}

/// Writes a page for the program and one for each verb.
pub(super) fn man_pages(arguments: &ManPages) -> Result<(), Failure> {
    let mut program = Cli::command();
    program.build();
    page(arguments, &program, "splitplane")?;
    let shown = |verb: &&clap::Command| !verb.is_hide_set() && verb.get_name() != "help";
    for verb in program.get_subcommands().filter(shown) {
        page(arguments, verb, &format!("splitplane-{}", verb.get_name()))?;
    }
    Ok(())
}

fn page(arguments: &ManPages, command: &clap::Command, name: &str) -> Result<(), Failure> {
    let mut text = Vec::new();
    let command = command.clone().name(name.to_owned());
    Man::new(command)
        .render(&mut text)
        .map_err(|error| Failure::file(format!("{name}.1 cannot be made: {error}")))?;
    files::write(&arguments.folder.join(format!("{name}.1")), &text)
}
