//! `plumb completions` and `plumb man`: what a shell and `man` are given of the program.
//!
//! In: the one definition of the command line, from which `--help` comes too. Out: a completion
//! script on stdout, or manual pages, one for the program and one for each verb.
//!
//! Left out: where a system keeps such files; docs/command-line.md has what the exit status means.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Command};
use clap_complete::Shell;
use clap_mangen::Man;

use output::stdout;
use output::write::{Existing, Staged};

/// Which shell.
#[derive(Clone, Debug, Args)]
pub struct Completions {
    /// The shell that is to complete what is typed
    #[arg(value_enum)]
    pub shell: Shell,
}

/// Where the pages go.
#[derive(Clone, Debug, Args)]
pub struct ManualPages {
    /// Verb whose page is printed; the program's own when not given
    #[arg(value_name = "VERB", conflicts_with = "output")]
    pub verb: Option<String>,
    /// Folder for all pages, plumb.1 and plumb-VERB.1; one page is printed when not given
    #[arg(long, value_name = "DIR")]
    pub output: Option<PathBuf>,
}

/// Why nothing was written.
#[derive(Debug, thiserror::Error)]
pub enum ShellError {
    /// There is no such verb.
    #[error("there is no verb {0:?}; `plumb --help` lists those there are")]
    Verb(String),
    /// A file or folder could not be written.
    #[error("cannot write {path}: {1}; choose another folder with --output", path = .0.display())]
    Write(PathBuf, io::Error),
    /// It could not be printed.
    #[error("it cannot be printed: {0}")]
    Print(io::Error),
}

/// Prints a completion script; exit status 0.
///
/// Errors: [`ShellError::Print`].
pub fn completions(arguments: &Completions, mut line: Command) -> Result<ExitCode, ShellError> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut line, "plumb", &mut script);
    if arguments.shell == Shell::Fish {
        script.extend(fish_values(&line).into_bytes());
    }
    print(&script)
}

/// The values of arguments without a name, which `clap_complete` leaves out for fish.
fn fish_values(line: &Command) -> String {
    let mut script = String::new();
    for verb in line.get_subcommands() {
        for argument in verb.get_positionals() {
            let values = argument.get_possible_values();
            let values: Vec<_> = values.iter().map(|value| value.get_name()).collect();
            if !values.is_empty() {
                script += &format!(
                    "complete -c plumb -n \"__fish_plumb_using_subcommand {}\" -f -a \"{}\"\n",
                    verb.get_name(),
                    values.join(" ")
                );
            }
        }
    }
    script
}

/// Prints a page, or writes all of them; exit status 0.
///
/// Errors: see [`ShellError`].
pub fn manual(arguments: &ManualPages, line: Command) -> Result<ExitCode, ShellError> {
    let pages = pages(line).map_err(ShellError::Print)?;
    if let Some(folder) = &arguments.output {
        return write_all(folder, &pages);
    }
    let wanted = match &arguments.verb {
        Some(verb) => format!("plumb-{verb}.1"),
        None => "plumb.1".to_owned(),
    };
    let page = pages.iter().find(|page| page.name == wanted);
    match (page, &arguments.verb) {
        (Some(page), _) => print(&page.text),
        (None, verb) => Err(ShellError::Verb(verb.clone().unwrap_or_default())),
    }
}

/// One manual page.
struct Page {
    /// The name of its file.
    name: String,
    /// As troff.
    text: Vec<u8>,
}

/// The page of the program, then those of its verbs.
fn pages(mut line: Command) -> io::Result<Vec<Page>> {
    line = line.disable_help_subcommand(true);
    // Fills in what follows from the rest, the names of verbs in full among it.
    line.build();
    let verbs = line.get_subcommands().filter(|verb| !verb.is_hide_set());
    std::iter::once(&line)
        .chain(verbs)
        .map(|command| page(command.clone()))
        .collect()
}

fn page(command: Command) -> io::Result<Page> {
    let name = command.get_display_name().unwrap_or("plumb").to_owned();
    let mut text = Vec::new();
    Man::new(command.name(name.clone())).render(&mut text)?;
    let name = format!("{name}.1");
    Ok(Page { name, text })
}

fn write_all(folder: &Path, pages: &[Page]) -> Result<ExitCode, ShellError> {
    let failed = |path: &Path, why| ShellError::Write(path.to_path_buf(), why);
    fs::create_dir_all(folder).map_err(|why| failed(folder, why))?;
    for page in pages {
        let path = folder.join(&page.name);
        let written = Staged::write(&path, &page.text, Existing::Replace);
        let written = written.and_then(Staged::put_in_place);
        written.map_err(|why| failed(&path, why))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn print(text: &[u8]) -> Result<ExitCode, ShellError> {
    stdout::print(text).map_err(ShellError::Print)?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;
    use crate::CommandLine;

    fn text(page: &Page) -> String {
        String::from_utf8(page.text.clone()).unwrap()
    }

    #[test]
    fn every_verb_has_a_page_that_names_its_options() {
        let line = CommandLine::command();
        let pages = pages(line.clone()).unwrap();
        for verb in line.get_subcommands() {
            let name = format!("plumb-{}.1", verb.get_name());
            let page = pages.iter().find(|page| page.name == name);
            let page = text(page.unwrap_or_else(|| panic!("no {name}")));
            for option in verb.get_arguments().filter_map(|o| o.get_long()) {
                let written = option.replace('-', "\\-");
                assert!(
                    page.contains(&format!("\\-\\-{written}")),
                    "{name}: {option}"
                );
            }
        }
    }

    #[test]
    fn the_page_of_the_program_tells_the_exit_status() {
        let pages = pages(CommandLine::command()).unwrap();
        assert_eq!(pages[0].name, "plumb.1");
        assert!(text(&pages[0]).contains("Exit status: 0"));
    }

    #[test]
    fn every_shell_gets_every_verb() {
        use clap::ValueEnum as _;
        for shell in Shell::value_variants() {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut CommandLine::command(), "plumb", &mut script);
            let script = String::from_utf8(script).unwrap();
            for verb in CommandLine::command().get_subcommands() {
                assert!(
                    script.contains(verb.get_name()),
                    "{shell}: {}",
                    verb.get_name()
                );
            }
        }
    }

    #[test]
    fn every_verb_states_what_it_is_for_and_what_each_option_does() {
        for verb in CommandLine::command().get_subcommands() {
            let name = verb.get_name();
            assert!(verb.get_about().is_some(), "{name}");
            for option in verb.get_arguments().filter(|o| !o.is_hide_set()) {
                assert!(option.get_help().is_some(), "{name}: {}", option.get_id());
            }
        }
    }
}
