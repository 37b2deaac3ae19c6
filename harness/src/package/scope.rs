//! Finds the names in a declaration that refer to something outside of it.
//!
//! The linker ignores a function's own parameters and variables, members of structures, and the words of attributes and
//! address spaces. All other names are references: to declarations of this or another module, or to WGSL's own names.

use std::collections::HashMap;
use std::ops::Range;

use super::brackets::{after_attribute, end_of_item};
use super::lexer::Kind;
use super::syntax::{Declaration, DeclarationKind, Module, Reference};

pub(super) fn references(module: &Module, declaration: &Declaration) -> Vec<Reference> {
    let mut walk = Walk {
        module,
        brackets: &module.brackets,
        scopes: Vec::new(),
        visible: HashMap::new(),
        pending: Vec::new(),
        found: Vec::new(),
    };
    let Range { start, end } = declaration.tokens;
    match declaration.kind {
        DeclarationKind::Function => walk.function(start, declaration.name_token, end),
        DeclarationKind::Struct => walk.structure(start, declaration.name_token, end),
        DeclarationKind::Value => {
            let at = walk.attributes(start);
            // Only an address space may stand between the keyword and the name.
            debug_assert!(at < declaration.name_token);
            walk.expressions(declaration.name_token + 1, end);
        }
        DeclarationKind::Assertion => {
            let at = walk.attributes(start);
            walk.expressions(at + 1, end);
        }
    }
    walk.found
}

struct Walk<'a> {
    module: &'a Module,
    brackets: &'a [usize],
    /// The blocks around the current token, with the names that each block declares.
    scopes: Vec<Scope<'a>>,
    /// For each name, the number of blocks in `scopes` that declare the name.
    visible: HashMap<&'a str, usize>,
    /// Names that become visible at the end of their statement.
    pending: Vec<&'a str>,
    found: Vec<Reference>,
}

struct Scope<'a> {
    names: Vec<&'a str>,
    /// The index of the token after the block.
    end: usize,
}

impl<'a> Walk<'a> {
    fn function(&mut self, start: usize, name: usize, end: usize) {
        self.attributes(start);
        let open = name + 1;
        if !self.module.is(open, b'(') {
            return self.expressions(open, end);
        }
        let module = self.module;
        let close = self.brackets[open];
        let mut parameters = Vec::new();
        let mut at = open + 1;
        while at < close {
            at = self.attributes(at);
            if self.module.is_word(at) && self.module.is(at + 1, b':') {
                parameters.push(self.module.text(at));
                at += 2;
            }
            let next = end_of_item(&module.tokens, self.brackets, at).unwrap_or(close);
            self.expressions(at, next);
            at = next + 1;
        }
        // The parameters are visible in the body, but not in the type of the result.
        let mut body = close + 1;
        while body < end && !self.module.is(body, b'{') {
            body += 1;
        }
        self.expressions(close + 1, body);
        self.scopes.push(Scope { names: Vec::new(), end });
        self.declare(parameters);
        self.statements(body, end);
    }

    fn declare(&mut self, names: Vec<&'a str>) {
        let Some(scope) = self.scopes.last_mut() else { return };
        for name in &names {
            *self.visible.entry(name).or_default() += 1;
        }
        scope.names.extend(names);
    }

    fn structure(&mut self, start: usize, name: usize, end: usize) {
        self.attributes(start);
        let open = name + 1;
        if !self.module.is(open, b'{') {
            return self.expressions(open, end);
        }
        let module = self.module;
        let close = self.brackets[open];
        let mut at = open + 1;
        while at < close {
            at = self.attributes(at);
            if module.is_word(at) && module.is(at + 1, b':') {
                at += 2;
            }
            let next = end_of_item(&module.tokens, self.brackets, at).unwrap_or(close);
            self.expressions(at, next);
            at = next + 1;
        }
    }

    /// Skips attributes. Names in an attribute's arguments are references if the arguments are expressions.
    fn attributes(&mut self, from: usize) -> usize {
        let mut at = from;
        while self.module.is(at, b'@') && self.module.is_word(at + 1) {
            let next =
                after_attribute(&self.module.file.text, &self.module.tokens, self.brackets, at);
            // The arguments of these attributes have a fixed meaning, even if a declaration has the same name.
            let words = matches!(
                self.module.text(at + 1),
                "builtin" | "interpolate" | "diagnostic" | "early_depth_test"
            );
            if !words && next > at + 3 {
                self.expressions(at + 3, next - 1);
            }
            at = next;
        }
        at
    }

    fn statements(&mut self, from: usize, end: usize) {
        let mut at = from;
        while at < end {
            while self.scopes.last().is_some_and(|scope| scope.end <= at) {
                let scope = self.scopes.pop().expect("there is a last one");
                for name in scope.names {
                    *self.visible.get_mut(name).expect("it was declared") -= 1;
                }
            }
            let token = &self.module.tokens[at];
            match token.kind {
                Kind::Symbol(b'{') => {
                    self.scopes.push(Scope { names: Vec::new(), end: self.brackets[at] + 1 });
                    at += 1;
                }
                Kind::Symbol(b';') => {
                    let names = std::mem::take(&mut self.pending);
                    self.declare(names);
                    at += 1;
                }
                Kind::Symbol(b'@') => at = self.attributes(at).max(at + 1),
                Kind::Word => match self.module.text(at) {
                    "let" | "const" | "var" => {
                        let mut name = at + 1;
                        if self.module.is(name, b'<') {
                            while name < end && !self.module.is(name, b'>') {
                                name += 1;
                            }
                            name += 1;
                        }
                        if self.module.is_word(name) {
                            self.pending.push(self.module.text(name));
                        }
                        at = name + 1;
                    }
                    // Names in the header of a `for` are visible until the end of its body.
                    "for" if self.module.is(at + 1, b'(') => {
                        let body = self.brackets[at + 1] + 1;
                        let mut open = body;
                        while open < end && !self.module.is(open, b'{') {
                            open += 1;
                        }
                        let last = if open < end { self.brackets[open] + 1 } else { end };
                        self.scopes.push(Scope { names: Vec::new(), end: last });
                        at += 1;
                    }
                    _ => at = self.name(at, end),
                },
                _ => at += 1,
            }
        }
    }

    fn expressions(&mut self, from: usize, end: usize) {
        let mut at = from;
        while at < end {
            at = match self.module.tokens[at].kind {
                Kind::Word => self.name(at, end),
                Kind::Symbol(b'@') => self.attributes(at).max(at + 1),
                _ => at + 1,
            };
        }
    }

    /// Reads a name or path at `at`. Returns the index of the token after the name or path.
    fn name(&mut self, at: usize, end: usize) -> usize {
        let module = self.module;
        if at > 0 && module.is(at - 1, b'.') {
            return at + 1;
        }
        let mut last = at;
        while last + 3 < end
            && module.is(last + 1, b':')
            && module.is(last + 2, b':')
            && module.is_word(last + 3)
        {
            last += 3;
        }
        let name = module.text(at);
        if last > at {
            self.found.push(Reference { tokens: at..last + 1 });
            return last + 1;
        }
        if self.visible.get(name).is_none_or(|count| *count == 0) {
            self.found.push(Reference { tokens: at..at + 1 });
            if module.is(at + 1, b'<') {
                return self.after_spaces(at, end);
            }
        }
        at + 1
    }

    /// Returns the index of the token after a type such as `ptr<storage, T>` or `texture_storage_2d<rgba8unorm,
    /// write>`. Words such as `storage` aren't references, even if a declaration has such a name.
    fn after_spaces(&mut self, at: usize, end: usize) -> usize {
        let name = self.module.text(at);
        let all = name.starts_with("texture_storage_")
            || matches!(name, "ray_query" | "acceleration_structure");
        if !all && name != "ptr" {
            return at + 1;
        }
        let (mut depth, mut argument, mut token) = (1_usize, 0, at + 2);
        while token < end && depth > 0 {
            match self.module.tokens[token].kind {
                Kind::Symbol(b'<') => depth += 1,
                Kind::Symbol(b'>') => depth -= 1,
                Kind::Symbol(b',') if depth == 1 => argument += 1,
                // In `ptr<function, T, read_write>`, only the type in the middle contains names.
                Kind::Word if !all && argument == 1 => {
                    let next = self.name(token, end);
                    // Brackets inside of the type belong to the type.
                    token = next;
                    continue;
                }
                _ => {}
            }
            token += 1;
        }
        token
    }
}
