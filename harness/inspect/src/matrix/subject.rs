//! Prepares the function or entry point of a row, with its translations.

use std::sync::Arc;

use karat::unstable::package::{FunctionItem, for_validating};
use karat::unstable::path::Via;
use karat::unstable::probe::{ProbeError, Probed};
use karat::unstable::reflect::{Program, ReflectError, parsed_with};
use karat_translate::{Shader, TranslateError, Translation};

use super::column::Written;
use super::{Column, Request, Row, Source};

/// A function or an entry point with its translations, or only a row with an error if Karat can't prepare it.
pub(super) enum Subject {
    Row(Box<Row>),
    Ready(Box<Ready>),
}

/// A function or entry point that is ready to run.
pub(super) struct Ready {
    pub(super) row: Row,
    pub(super) about: About,
    /// One translation for each kind of text. Columns that run or check the same text share its translation.
    pub(super) made: Vec<Made>,
}

/// The function or the entry point of a row. A function has a kernel that calls it.
pub(super) enum About {
    Function(Box<Probed>),
    EntryPoint { program: Arc<Program>, name: String },
}

pub(super) struct Made {
    pub(super) written: Written,
    pub(super) translation: Result<Translation, TranslateError>,
}

impl Subject {
    pub(super) fn ready(&self) -> Option<&Ready> {
        match self {
            Self::Ready(ready) => Some(ready),
            Self::Row(_) => None,
        }
    }
}

impl Ready {
    pub(super) fn of(&self, column: Column) -> &Made {
        let made = self.made.iter().find(|made| made.written == column.written());
        made.expect("each column has a translation")
    }

    pub(super) fn row(self, cells: Vec<super::Cell>) -> Row {
        Row { cells, ..self.row }
    }

    pub(super) fn text(&self) -> &str {
        match &self.about {
            About::Function(probed) => probed.kernel(),
            About::EntryPoint { program, .. } => program.text(),
        }
    }

    /// The name that the function or entry point has in the translated text.
    pub(super) fn name(&self) -> &str {
        match &self.about {
            About::Function(probed) => {
                let path = &probed.function().name;
                probed.program.name_of(path)
            }
            About::EntryPoint { name, .. } => name,
        }
    }
}

/// Checks if naga must read its own output for this column.
pub(super) fn is_read_back(column: Column) -> bool {
    column.path.is_some_and(|path| matches!(path.via(), Via::Spirv | Via::Wgsl))
}

/// Links, reflects and translates a function or entry point.
pub(super) fn prepare(request: &Request, item: &FunctionItem) -> Subject {
    let text = &item.whole.file.text[item.whole.range.clone()];
    let (line, _) = item.whole.file.line_column(item.whole.range.start);
    let row = |kind: &str, error: Option<String>| Row {
        name: item.name.clone(),
        kind: kind.to_owned(),
        location: item.span.to_string(),
        text: "".into(),
        buffers: Vec::new(),
        source: Source { file: item.span.file.name.clone(), line, text: text.to_owned() },
        error,
        cells: Vec::new(),
    };
    let failed = |kind: &str, error: String| Subject::Row(Box::new(row(kind, Some(error))));
    if item.entry_point.is_some() {
        return match entry_point(request, item) {
            Ok((shader, program, name, kind)) => {
                let made = translated(request, &shader, program.text(), None, &name);
                let about = About::EntryPoint { program, name };
                Subject::Ready(Box::new(Ready { row: row(&kind, None), about, made }))
            }
            Err(error) => failed("entry point", error),
        };
    }
    match request.probed(&item.name) {
        Ok(probed) => match shader(probed.kernel(), &probed.program) {
            Ok(shader) => {
                let own = own(request, item);
                let (text, name) = (probed.kernel(), Probed::ENTRY_POINT);
                let made = translated(request, &shader, text, own.as_deref(), name);
                let about = About::Function(Box::new(probed));
                Subject::Ready(Box::new(Ready { row: row("function", None), about, made }))
            }
            Err(error) => failed("function", error),
        },
        // Nothing can call the function: it has no parameters or result that Karat can handle, or it belongs to another
        // stage.
        Err(ProbeError::Reflect(ReflectError::Unprobeable(why) | ReflectError::Override(why))) => {
            failed("not callable", why.to_string())
        }
        Err(error) => failed("function", error.to_string()),
    }
}

type EntryPoint = (Shader, Arc<Program>, String, String);

fn entry_point(request: &Request, item: &FunctionItem) -> Result<EntryPoint, String> {
    let (module, own) = item.name.rsplit_once("::").unwrap_or(("", &item.name));
    // The entry point is linked without the others, because a path may not support what another entry point of the
    // module uses.
    let program = Program::of_items(&for_validating(&request.package, module), module, &[own]);
    let program = program.map_err(|error| error.to_string())?;
    let given = request.overrides_of(&program);
    let program = match given.is_empty() {
        true => program,
        false => program.overridden(&given).map_err(|error| error.to_string())?,
    };
    let shader = shader(program.text(), &program)?;
    let name = program.entry_point_name(own).to_owned();
    let known = shader.entry_points().into_iter().find(|e| e.name == name);
    let stage = known.ok_or_else(|| format!("naga finds no entry point `{name}`"))?.stage;
    Ok((shader, program, name, stage.to_string()))
}

/// A program's text as a naga module, with the values of its overrides.
fn shader(text: &str, program: &Program) -> Result<Shader, String> {
    let module = Arc::unwrap_or_clone(parsed_with(text, program.overrides())?);
    Shader::of(module).map_err(|error| error.to_string())
}

/// The text of a function with everything that it uses, as its author wrote it.
fn own(request: &Request, item: &FunctionItem) -> Option<String> {
    let (module, name) = item.name.rsplit_once("::").unwrap_or(("", &item.name));
    let program = Program::of_items(&request.package, module, &[name]).ok()?;
    Some(program.text().to_owned())
}

/// The translations of a text. `own` is the part that the author wrote, if the text also has a kernel that Karat added.
fn translated(
    request: &Request,
    shader: &Shader,
    text: &str,
    own: Option<&str>,
    entry_point: &str,
) -> Vec<Made> {
    let mut made: Vec<Made> = Vec::new();
    for column in &request.columns {
        let written = column.written();
        if made.iter().all(|made| made.written != written) {
            let translation = match written {
                Written::ByNaga(target) => shader.translate(target, Some(entry_point)),
                Written::ByAuthor => shader.as_it_is(text, entry_point),
                Written::ForTint => shader.as_it_is(own.unwrap_or(text), entry_point),
            };
            made.push(Made { written, translation });
        }
    }
    made
}
