//! Makes mutants of WGSL text. Each mutant has one mistake, in the body of a function or in the value of a constant.
//!
//! This module works on text and knows no types, so some mutants aren't valid WGSL.

use std::collections::BTreeSet;
use std::fmt;
use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::tokens::{Kind, Token, tokens};

/// The kind of a mutation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// `-` in place of `+`, `/` in place of `*`, and similar changes of bit operators.
    Operator,
    /// `<=` in place of `<`, or the reverse.
    Comparison,
    /// `||` in place of `&&`, or a missing `!`.
    Logic,
    /// A number replaced by 0, 1, 2, its double, or a slightly larger number.
    Number,
    /// A missing term or factor.
    Operand,
    /// A call such as `max`, `abs` or `clamp`, replaced by one of its arguments.
    Guard,
    /// Two neighbouring arguments in the reverse order.
    Swap,
    /// Another component of a vector, or two components in the reverse order.
    Swizzle,
    /// A missing minus sign.
    Sign,
    /// A condition that is always true, or always false.
    Condition,
    /// A missing barrier, or a missing atomic operation whose result isn't used.
    Order,
    /// A sampler in a test's declaration, with another filter or another address mode.
    Sampler,
}

impl fmt::Display for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Operator => "operator",
            Self::Comparison => "comparison",
            Self::Logic => "logic",
            Self::Number => "number",
            Self::Operand => "operand",
            Self::Guard => "guard",
            Self::Swap => "swap",
            Self::Swizzle => "swizzle",
            Self::Sign => "sign",
            Self::Condition => "condition",
            Self::Order => "order",
            Self::Sampler => "sampler",
        })
    }
}

/// A change of one place in a WGSL text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mutant {
    /// The mutation's kind.
    pub rule: Rule,
    /// The function or constant that contains the mutation.
    pub item: String,
    /// The byte range of the text that the mutation replaces.
    pub range: Range<usize>,
    /// The replaced text.
    pub original: String,
    /// The text that replaces `range`.
    pub replacement: String,
    /// The mutation's line, counted from 1.
    pub line: usize,
    /// The mutation's column in characters, counted from 1.
    pub column: usize,
}

impl Mutant {
    /// Applies the mutation to the whole text.
    #[must_use]
    pub fn applied(&self, text: &str) -> String {
        format!("{}{}{}", &text[..self.range.start], self.replacement, &text[self.range.end..])
    }

    /// The changed lines before and after the mutation, with single blanks and without comments. These texts stay the
    /// same if the lines move.
    #[must_use]
    pub fn lines(&self, text: &str) -> [String; 2] {
        let start = text[..self.range.start].rfind('\n').map_or(0, |at| at + 1);
        let end = text[self.range.end..].find('\n').map_or(text.len(), |at| self.range.end + at);
        let after = format!(
            "{}{}{}",
            &text[start..self.range.start],
            self.replacement,
            &text[self.range.end..end]
        );
        [&text[start..end], &after].map(|lines| {
            let code = lines.lines().map(|line| line.split("//").next().unwrap_or_default());
            code.flat_map(str::split_whitespace).collect::<Vec<_>>().join(" ")
        })
    }
}

impl fmt::Display for Mutant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let short = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let (original, replacement) = (short(&self.original), short(&self.replacement));
        write!(f, "{}:{} `{original}` -> `{replacement}`", self.line, self.column)
    }
}

/// Finds all mutants of a module, in the order of their positions.
#[must_use]
pub fn mutants(text: &str) -> Vec<Mutant> {
    let mut maker = Maker::new(text);
    maker.items();
    let mut found = maker.found;
    found.sort_by_key(|mutant| (mutant.range.start, mutant.range.end));
    // Two rules may produce the same text.
    let mut seen = BTreeSet::new();
    found.retain(|mutant| seen.insert(mutant.applied(text)) && mutant.applied(text) != text);
    // Lines with `@if(karat)` assert or print, so they aren't mutated.
    let line = |at: usize| text[..at].rsplit('\n').next().unwrap_or_default().trim_start();
    found.retain(|mutant| !line(mutant.range.start).starts_with("@if(karat)"));
    found
}

/// All mutants of the samplers that a test file declares, each with the name of the sampler's variable. A string in a
/// `with` table declares a sampler if the string begins with a filter: `filtering = "linear repeat"`.
pub(crate) fn samplers(text: &str) -> Vec<Mutant> {
    let mut found = Vec::new();
    if let Ok(table) = DeTable::parse(text) {
        below(table.get_ref(), false, &mut |name, value| {
            let DeValue::String(own) = value.get_ref() else { return };
            // The range within the quotes. The string has no escapes.
            let range = value.span().start + 1..value.span().end - 1;
            if text.get(range.clone()) == Some(own) {
                found.extend(of_sampler(text, name, range));
            }
        });
    }
    found.sort_by_key(|mutant| mutant.range.start);
    found
}

/// Calls `visit` with the key and the value of each entry below a `with` key.
fn below<'t>(
    table: &'t DeTable<'_>,
    is_below: bool,
    visit: &mut dyn FnMut(&str, &'t Spanned<DeValue<'_>>),
) {
    for (key, value) in table {
        let is_below_now = is_below || key.get_ref() == "with";
        match value.get_ref() {
            DeValue::Table(inner) => below(inner, is_below_now, visit),
            DeValue::Array(all) => {
                let tables = all.iter().filter_map(|one| one.get_ref().as_table());
                tables.for_each(|inner| below(inner, is_below_now, visit));
            }
            _ if is_below => visit(key.get_ref(), value),
            _ => {}
        }
    }
}

/// Mutants with another filter and another address mode, if the text describes a sampler.
fn of_sampler(text: &str, name: &str, range: Range<usize>) -> Vec<Mutant> {
    let words: Vec<&str> = text[range.clone()].split_whitespace().collect();
    let [filter @ ("linear" | "nearest"), rest @ ..] = &*words else { return Vec::new() };
    let is_address = |word: &&&str| ["clamp", "repeat", "mirror"].contains(*word);
    let address = rest.iter().find(is_address).copied();
    let with = |filter: &str, address: Option<&str>| {
        // The samplers' default address mode is `clamp`.
        let address = address.filter(|address| *address != "clamp");
        let others = rest.iter().filter(|word| !is_address(word)).copied();
        [filter].into_iter().chain(address).chain(others).collect::<Vec<_>>().join(" ")
    };
    let other = if *filter == "linear" { "nearest" } else { "linear" };
    let elsewhere = if address == Some("repeat") { "clamp" } else { "repeat" };
    let line_start = text[..range.start].rfind('\n').map_or(0, |at| at + 1);
    let mutant = |replacement: String| Mutant {
        rule: Rule::Sampler,
        item: name.to_owned(),
        range: range.clone(),
        original: text[range.clone()].to_owned(),
        replacement,
        line: text[..range.start].matches('\n').count() + 1,
        column: text[line_start..range.start].chars().count() + 1,
    };
    [with(other, address), with(filter, Some(elsewhere))].map(mutant).to_vec()
}

struct Maker<'a> {
    text: &'a str,
    tokens: Vec<Token<'a>>,
    /// For each token that is a bracket, the index of the matching bracket.
    partner: Vec<Option<usize>>,
    /// For each token, `true` if the token belongs to an attribute or to a template argument list. `<` and `>` belong
    /// to the list.
    types: Vec<bool>,
    item: String,
    found: Vec<Mutant>,
}

impl<'a> Maker<'a> {
    fn new(text: &'a str) -> Self {
        let tokens = split_templates(tokens(text));
        let count = tokens.len();
        let mut partner = vec![None; count];
        let mut open = Vec::new();
        for (at, token) in tokens.iter().enumerate() {
            match token.text {
                "(" | "[" | "{" => open.push(at),
                ")" | "]" | "}" => {
                    if let Some(other) = open.pop() {
                        partner[other] = Some(at);
                        partner[at] = Some(other);
                    }
                }
                _ => {}
            }
        }
        let mut maker = Self {
            text,
            tokens,
            partner,
            types: vec![false; count],
            item: String::new(),
            found: Vec::new(),
        };
        for at in 0..count {
            if let Some(end) = maker.template_end(at).or_else(|| maker.attribute_end(at)) {
                maker.types[at..=end].fill(true);
            }
        }
        maker
    }

    fn word(&self, at: usize) -> &'a str {
        self.tokens.get(at).map_or("", |token| token.text)
    }

    /// The index of the `>` that ends the template argument list after a `<`. Returns `None` if a token such as `;` or
    /// `&&` comes before the `>`: then the `<` is a comparison.
    fn template_end(&self, at: usize) -> Option<usize> {
        let after_word = at > 0 && self.tokens[at - 1].kind == Kind::Word;
        if self.word(at) != "<" || !after_word {
            return None;
        }
        let mut depth = 0;
        let mut next = at;
        while next < self.tokens.len() {
            match self.word(next) {
                "<" => depth += 1,
                ">" => {
                    depth -= 1;
                    if depth == 0 {
                        return Some(next);
                    }
                }
                "(" | "[" => next = self.partner[next]?,
                ")" | "]" | "{" | "}" | ";" | ":" | "=" | "==" | "!=" | "<=" | ">=" | "&&"
                | "||" => {
                    return None;
                }
                _ => {}
            }
            next += 1;
        }
        None
    }

    fn attribute_end(&self, at: usize) -> Option<usize> {
        if self.word(at) != "@" {
            return None;
        }
        let name = at + 1;
        let arguments = (self.word(name + 1) == "(").then(|| self.partner[name + 1]).flatten();
        arguments.or_else(|| (name < self.tokens.len()).then_some(name))
    }

    fn items(&mut self) {
        let mut at = 0;
        while at < self.tokens.len() {
            let name = self.word(at + 1).to_owned();
            match self.word(at) {
                "fn" => {
                    let open = (at..self.tokens.len()).find(|i| self.word(*i) == "{");
                    let body = open.and_then(|open| Some((open, self.partner[open]?)));
                    // In conditional text, a brace may have no matching brace. Karat still mutates the text after it.
                    let Some((open, close)) = body else {
                        at += 1;
                        continue;
                    };
                    self.item = name;
                    self.body(open + 1..close);
                    at = close;
                }
                "const" | "override" => {
                    let end = self.find(at, ";");
                    let value = self.find(at, "=");
                    self.item = name;
                    self.body(value + 1..end);
                    at = end;
                }
                "{" => at = self.partner[at].unwrap_or(at),
                _ => {}
            }
            at += 1;
        }
    }

    fn find(&self, from: usize, text: &str) -> usize {
        (from..self.tokens.len()).find(|at| self.word(*at) == text).unwrap_or(self.tokens.len())
    }

    fn body(&mut self, tokens: Range<usize>) {
        for at in tokens {
            if self.types[at] {
                continue;
            }
            match self.tokens[at].kind {
                Kind::Number => self.number(at),
                Kind::Symbol => self.symbol(at),
                Kind::Word if self.word(at) == "if" => self.condition(at),
                Kind::Word if at > 0 && self.word(at - 1) == "." => self.swizzle(at),
                Kind::Word => self.call(at),
            }
        }
    }

    fn replace(&mut self, rule: Rule, from: usize, to: usize, replacement: String) {
        let range = self.tokens[from].start..self.tokens[to].end();
        let before = &self.text[..range.start];
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        self.found.push(Mutant {
            rule,
            item: self.item.clone(),
            original: self.text[range.clone()].to_owned(),
            replacement,
            line: before.matches('\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
            range,
        });
    }

    fn between(&self, from: usize, to: usize) -> String {
        self.text[self.tokens[from].start..self.tokens[to].end()].to_owned()
    }

    fn number(&mut self, at: usize) {
        for replacement in numbers(self.word(at)) {
            self.replace(Rule::Number, at, at, replacement);
        }
    }

    fn symbol(&mut self, at: usize) {
        let text = self.word(at);
        if self.is_unary(at) {
            let rule = if text == "-" { Rule::Sign } else { Rule::Logic };
            if text == "-" || text == "!" {
                self.replace(rule, at, at, String::new());
            }
            return;
        }
        let (rule, replacements): (Rule, &[&str]) = match text {
            "+" => (Rule::Operator, &["-"]),
            "-" => (Rule::Operator, &["+"]),
            "*" => (Rule::Operator, &["/"]),
            "/" | "%" => (Rule::Operator, &["*"]),
            "+=" => (Rule::Operator, &["-=", "="]),
            "-=" => (Rule::Operator, &["+=", "="]),
            "*=" => (Rule::Operator, &["/=", "="]),
            "/=" => (Rule::Operator, &["*=", "="]),
            "&" => (Rule::Operator, &["|"]),
            "|" => (Rule::Operator, &["&"]),
            "^" => (Rule::Operator, &["|"]),
            "<<" => (Rule::Operator, &[">>"]),
            ">>" => (Rule::Operator, &["<<"]),
            "<" => (Rule::Comparison, &["<=", ">="]),
            "<=" => (Rule::Comparison, &["<", ">"]),
            ">" => (Rule::Comparison, &[">=", "<="]),
            ">=" => (Rule::Comparison, &[">", "<"]),
            "==" => (Rule::Comparison, &["!="]),
            "!=" => (Rule::Comparison, &["=="]),
            "&&" => (Rule::Logic, &["||"]),
            "||" => (Rule::Logic, &["&&"]),
            _ => return,
        };
        for replacement in replacements {
            self.replace(rule, at, at, (*replacement).to_owned());
        }
        if matches!(text, "+" | "-" | "*" | "/" | "%" | "&&" | "||") {
            self.operands(at);
        }
    }

    /// Removes one operand of an operator.
    fn operands(&mut self, at: usize) {
        let (left, right) = (self.left_operand(at), self.right_operand(at));
        let [kept_left, kept_right] = [self.between(left, at - 1), self.between(at + 1, right)];
        self.replace(Rule::Operand, left, right, kept_left);
        // If another operator of equal precedence precedes the left operand, that operator's mutant already removes it.
        let first = left == 0 || precedence(self.word(left - 1)) != precedence(self.word(at));
        match self.word(at) {
            "/" | "%" => {}
            _ if !first => {}
            "-" => self.replace(Rule::Operand, left, right, format!("-{kept_right}")),
            _ => self.replace(Rule::Operand, left, right, kept_right),
        }
    }

    /// The index of the left operand's first token. All operators in the operand bind more tightly than the operator at
    /// `at`.
    fn left_operand(&self, at: usize) -> usize {
        let binds = precedence(self.word(at));
        let mut first = at;
        while first > 0 {
            let before = first - 1;
            let text = self.word(before);
            if matches!(text, ")" | "]") {
                match self.partner[before] {
                    Some(open) => first = open,
                    None => return first,
                }
                continue;
            }
            let ends = matches!(text, "(" | "[" | "{" | "}" | "," | ";" | "return" | "=" | ":")
                || text.len() > 1 && text.ends_with('=') && precedence(text).is_none()
                || !self.types[before]
                    && !self.is_unary(before)
                    && precedence(text).is_some_and(|other| Some(other) <= binds);
            if ends {
                return first;
            }
            first = before;
        }
        first
    }

    /// The index of the right operand's last token. The operand ends before the next operator that binds as tightly as
    /// the operator at `at`, or less tightly.
    fn right_operand(&self, at: usize) -> usize {
        let binds = precedence(self.word(at));
        let mut last = at;
        while last + 1 < self.tokens.len() {
            let next = last + 1;
            let text = self.word(next);
            if matches!(text, "(" | "[") {
                match self.partner[next] {
                    Some(close) => last = close,
                    None => return last,
                }
                continue;
            }
            let ends = matches!(text, ")" | "]" | "{" | "}" | "," | ";" | ":")
                || !self.types[next]
                    && !self.is_unary(next)
                    && precedence(text).is_some_and(|other| Some(other) <= binds);
            if ends {
                return last;
            }
            last = next;
        }
        last
    }

    /// Checks if an operator has no left operand.
    fn is_unary(&self, at: usize) -> bool {
        if !matches!(self.word(at), "-" | "!" | "~" | "&" | "*") {
            return false;
        }
        let Some(before) = at.checked_sub(1) else { return true };
        let text = self.word(before);
        match self.tokens[before].kind {
            Kind::Number => false,
            Kind::Word => matches!(text, "return" | "case" | "if" | "switch" | "while"),
            Kind::Symbol => !(matches!(text, ")" | "]") || text == ">" && self.types[before]),
        }
    }

    /// Replaces the condition of an `if` with `true` and with `false`.
    fn condition(&mut self, at: usize) {
        let mut end = at + 1;
        // The condition of a `break if` ends at the semicolon.
        while end < self.tokens.len() && !matches!(self.word(end), "{" | ";") {
            end = if self.word(end) == "(" { self.partner[end].unwrap_or(end) } else { end } + 1;
        }
        for outcome in ["true", "false"] {
            self.replace(Rule::Condition, at + 1, end - 1, format!("({outcome})"));
        }
    }

    /// Replaces a component (`x` with `y`), or exchanges the first two components.
    fn swizzle(&mut self, at: usize) {
        let text = self.word(at);
        let set = ["xyzw", "rgba"].into_iter().find(|set| text.chars().all(|c| set.contains(c)));
        let Some(set) = set.filter(|_| self.word(at + 1) != "(") else { return };
        let mut components: Vec<char> = text.chars().collect();
        if components.len() == 1 {
            let first = set.chars().next().unwrap_or_default();
            let second = set.chars().nth(1).unwrap_or_default();
            components[0] = if components[0] == first { second } else { first };
        } else {
            components.swap(0, 1);
        }
        self.replace(Rule::Swizzle, at, at, components.into_iter().collect());
    }

    /// Replaces a guard with one of its arguments, and exchanges neighbouring arguments.
    fn call(&mut self, at: usize) {
        let Some((open, close)) = self.parentheses(at) else { return };
        self.order(at, close);
        let arguments = self.arguments(open, close);
        let text = |(from, to): (usize, usize)| self.between(from, to);
        let texts: Vec<String> = arguments.iter().copied().map(text).collect();
        let kept = match self.word(at) {
            "max" | "min" | "select" => 2,
            "clamp" | "saturate" | "abs" | "normalize" | "sqrt" | "floor" | "fract" | "round"
            | "trunc" | "sign" | "exp" | "exp2" | "log" | "log2" | "transpose" => 1,
            _ => 0,
        };
        for text in texts.iter().take(kept) {
            self.replace(Rule::Guard, at, close, format!("({text})"));
        }
        if matches!(self.word(at), "max" | "min" | "dot" | "distance") {
            return; // the order of the arguments doesn't matter
        }
        for (index, pair) in texts.windows(2).enumerate() {
            let (from, to) = (arguments[index].0, arguments[index + 1].1);
            self.replace(Rule::Swap, from, to, format!("{}, {}", pair[1], pair[0]));
        }
    }

    /// Removes a barrier, or an atomic operation that is a whole statement.
    fn order(&mut self, at: usize, close: usize) {
        let word = self.word(at);
        let orders = word.starts_with("atomic")
            || matches!(word, "workgroupBarrier" | "storageBarrier" | "textureBarrier");
        let is_alone = at > 0 && matches!(self.word(at - 1), "{" | "}" | ";" | ")" | ":");
        if orders && is_alone && self.word(close + 1) == ";" {
            self.replace(Rule::Order, at, close + 1, ";".to_owned());
        }
    }

    /// The parentheses of the call at `at`. Template arguments can stand between the name and the parentheses.
    fn parentheses(&self, at: usize) -> Option<(usize, usize)> {
        if matches!(self.word(at), "if" | "for" | "while" | "switch" | "return" | "else") {
            return None;
        }
        let open = self.template_end(at + 1).map_or(at + 1, |end| end + 1);
        let called = self.word(open) == "(";
        called.then(|| Some((open, self.partner[open]?))).flatten()
    }

    /// The indices of each argument's first and last token.
    fn arguments(&self, open: usize, close: usize) -> Vec<(usize, usize)> {
        let mut found = Vec::new();
        let mut first = open + 1;
        let mut at = first;
        while at <= close {
            let ends = at == close || self.word(at) == "," && !self.types[at];
            if ends {
                if first < at {
                    found.push((first, at - 1));
                }
                first = at + 1;
            } else if let Some(other) = self.partner[at].filter(|other| *other > at) {
                at = other;
            }
            at += 1;
        }
        found
    }
}

/// Splits `>>` at the end of nested templates into two tokens. Shifts remain one token.
fn split_templates(tokens: Vec<Token<'_>>) -> Vec<Token<'_>> {
    let mut depth = 0_usize;
    let mut found = Vec::with_capacity(tokens.len());
    for (at, token) in tokens.iter().enumerate() {
        let generic = at > 0 && is_generic(tokens[at - 1].text);
        match token.text {
            "<" if generic || depth > 0 => depth += 1,
            ">" => depth = depth.saturating_sub(1),
            ">>" if depth > 1 => {
                depth -= 2;
                found.push(Token { text: &token.text[..1], ..*token });
                found.push(Token { text: &token.text[1..], start: token.start + 1, ..*token });
                continue;
            }
            ";" | "{" | "}" => depth = 0,
            _ => {}
        }
        found.push(*token);
    }
    found
}

/// Checks if a word, such as `vec3`, `array` or `bitcast`, can have template arguments.
fn is_generic(word: &str) -> bool {
    let begins = ["vec", "mat", "array", "ptr", "atomic", "texture_", "var", "bitcast"];
    begins.iter().any(|begin| word.starts_with(begin))
}

/// The precedence of a binary operator; `None` for other operators.
fn precedence(operator: &str) -> Option<u8> {
    Some(match operator {
        "||" => 1,
        "&&" => 2,
        "|" | "^" | "&" => 3,
        "==" | "!=" | "<" | "<=" | ">" | ">=" => 4,
        "<<" | ">>" => 5,
        "+" | "-" => 6,
        "*" | "/" | "%" => 7,
        _ => return None,
    })
}

/// The replacements of a number: 0 becomes 1, and 1 becomes 0 and 2. Any other number has two replacements: the double,
/// and a number that is larger by 1 (integers) or 1 % (floats). A hexadecimal number has no replacements.
fn numbers(text: &str) -> Vec<String> {
    let hexadecimal = text.starts_with("0x") || text.starts_with("0X");
    let digits = text.trim_end_matches(['f', 'h', 'i', 'u']);
    if hexadecimal {
        return Vec::new();
    }
    let suffix = &text[digits.len()..];
    let with_suffix = |number: String| format!("{number}{suffix}");
    if let Ok(integer) = digits.parse::<u64>()
        && !matches!(suffix, "f" | "h")
    {
        let others = match integer {
            0 => vec![1],
            1 => vec![0, 2],
            _ => vec![integer + 1, 2 * integer],
        };
        return others.into_iter().map(|other| with_suffix(other.to_string())).collect();
    }
    let Ok(number) = digits.parse::<f64>() else { return Vec::new() };
    let others = if number == 0.0 {
        vec![1.0]
    } else if number == 1.0 {
        vec![0.0, 2.0]
    } else {
        vec![2.0 * number, 1.01 * number]
    };
    // Writes each number with the digits of an `f32`.
    #[expect(clippy::cast_possible_truncation, reason = "it is written into a shader")]
    let written = |other: f64| with_suffix(format!("{:?}", other as f32));
    others.into_iter().map(written).filter(|other| !other.starts_with("inf")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_body(body: &str) -> Vec<(Rule, String)> {
        let text = format!("fn f() {{ {body} }}");
        let inner = |mutant: &Mutant| {
            let text = mutant.applied(&text);
            text["fn f() { ".len()..text.len() - 2].to_owned()
        };
        mutants(&text).iter().map(|mutant| (mutant.rule, inner(mutant))).collect()
    }

    fn by_rule(body: &str, rule: Rule) -> Vec<String> {
        let found = of_body(body).into_iter().filter(|(of, _)| *of == rule);
        found.map(|(_, text)| text).collect()
    }

    // Lesson 28: mutants
    #[test]
    fn each_mutation_rule_makes_its_mutants() {
        for (body, rule, expected) in [
            ("a = b + c;", Rule::Operator, vec!["a = b - c;"]),
            ("a += b;", Rule::Operator, vec!["a -= b;", "a = b;"]),
            ("a = b <= c;", Rule::Comparison, vec!["a = b < c;", "a = b > c;"]),
            ("a = b || !c;", Rule::Logic, vec!["a = b && !c;", "a = b || c;"]),
            ("a = 0.0;", Rule::Number, vec!["a = 1.0;"]),
            ("workgroupBarrier(); a = b;", Rule::Order, vec!["; a = b;"]),
            ("if (a) { atomicAdd(&s, 1u); }", Rule::Order, vec!["if (a) { ; }"]),
            ("a = atomicLoad(&s);", Rule::Order, vec![]),
            ("a = 1u;", Rule::Number, vec!["a = 0u;", "a = 2u;"]),
            ("a = 2.5f;", Rule::Number, vec!["a = 5.0f;", "a = 2.525f;"]),
            ("a = max(b, c);", Rule::Guard, vec!["a = (b);", "a = (c);"]),
            ("a = abs(b - c);", Rule::Guard, vec!["a = (b - c);"]),
            ("a = f(b, c, d);", Rule::Swap, vec!["a = f(c, b, d);", "a = f(b, d, c);"]),
            ("a = b.xyz;", Rule::Swizzle, vec!["a = b.yxz;"]),
            ("a = b.z;", Rule::Swizzle, vec!["a = b.x;"]),
            ("a = b * -c;", Rule::Sign, vec!["a = b * c;"]),
            (
                "loop { continuing { break if a; } }",
                Rule::Condition,
                vec![
                    "loop { continuing { break if (true); } }",
                    "loop { continuing { break if (false); } }",
                ],
            ),
            ("if (a) { b(); }", Rule::Condition, vec!["if (true) { b(); }", "if (false) { b(); }"]),
        ] {
            assert_eq!(by_rule(body, rule), expected, "{body}");
        }
    }

    #[test]
    fn operands_are_left_out_once() {
        for (body, expected) in [
            ("a = b + c * d;", vec!["a = b;", "a = c * d;", "a = b + c;", "a = b + d;"]),
            ("a = b * c * d;", vec!["a = b * d;", "a = c * d;", "a = b * c;"]),
            ("a = b - c;", vec!["a = b;", "a = -c;"]),
            ("a = (b + c) / d[e];", vec!["a = (b + c);", "a = (b) / d[e];", "a = (c) / d[e];"]),
            ("return f(a, -b * c);", vec!["return f(a, -b);", "return f(a, c);"]),
            ("if (a < b && c) { }", vec!["if (a < b) { }", "if (c) { }"]),
        ] {
            assert_eq!(sorted(by_rule(body, Rule::Operand)), sorted(texts(&expected)), "{body}");
        }
    }

    fn texts(expected: &[&str]) -> Vec<String> {
        expected.iter().map(|text| (*text).to_owned()).collect()
    }

    fn sorted(mut texts: Vec<String>) -> Vec<String> {
        texts.sort();
        texts
    }

    /// Comments, types, attributes, declarations and imports have no mutants.
    // Lesson 28: mutants
    #[test]
    fn only_code_is_changed() {
        let text = "import package::math::PI; // 1 + 2\n\
                    @group(0) @binding(1) var<uniform> u: vec2<f32>;\n\
                    struct S { @location(0) x: array<f32, 9>, }\n\
                    const N: u32 = 3u; /* 4 */\n\
                    @compute @workgroup_size(64)\n\
                    fn f(x: f32) -> array<vec2<f32>, 2> {\n    \
                        return array<vec2<f32>, 2>(g<7>(), h);\n\
                    }\n";
        let found = mutants(text);
        let shown: Vec<String> = found.iter().map(|m| format!("{} {m}", m.item)).collect();
        let expected =
            ["N 4:16 `3u` -> `4u`", "N 4:16 `3u` -> `6u`", "f 7:32 `g<7>(), h` -> `h, g<7>()`"];
        assert_eq!(shown, expected);
    }

    /// The `<` of a comparison doesn't begin a template, and the `>>` of a shift doesn't end a template.
    #[test]
    fn templates_are_not_comparisons() {
        assert_eq!(by_rule("if (a < b) { c = d > e; }", Rule::Comparison).len(), 4);
        assert_eq!(by_rule("a = b >> 2u;", Rule::Operator), ["a = b << 2u;"]);
        assert_eq!(by_rule("a = array<vec2<f32>>(b);", Rule::Operator), [""; 0]);
    }

    #[test]
    fn a_mutant_is_named_by_its_lines() {
        let text = "fn f() {\n    a = max(b, // why\n        c);\n}\n";
        let found = mutants(text);
        let guard = found.iter().find(|mutant| mutant.rule == Rule::Guard).expect("a guard");
        assert_eq!(guard.lines(text), ["a = max(b, c);", "a = (b);"]);
        assert_eq!((guard.line, guard.column), (2, 9));
    }

    /// All mutants differ from each other and from the original, and each records the text that it replaces.
    #[test]
    fn mutants_differ() {
        let text = "fn f() { return 1.0 * 1.0 + g(a, a) - max(a, a); }";
        let found = mutants(text);
        let texts: BTreeSet<String> = found.iter().map(|mutant| mutant.applied(text)).collect();
        assert_eq!(texts.len(), found.len());
        assert!(!texts.contains(text) && found.len() > 8);
        assert!(found.iter().all(|mutant| text[mutant.range.clone()] == mutant.original));
    }

    /// Samplers get another filter and another address mode. Names and comments don't change.
    #[test]
    fn samplers_of_tests_are_changed() {
        let text = "[[test]]\nname = \"linear\" # \"nearest\"\nwith = { a = \"linear\", b = \"nearest repeat\", c = \"x.png\" }\n\
                    [[test]]\nwith.shadow = \"linear less_equal\"\n";
        let found = samplers(text);
        let told: Vec<(&str, &str)> =
            found.iter().map(|one| (&*one.item, &*one.replacement)).collect();
        let expected = [
            ("a", "nearest"),
            ("a", "linear repeat"),
            ("b", "linear repeat"),
            ("b", "nearest"),
            ("shadow", "nearest less_equal"),
            ("shadow", "linear repeat less_equal"),
        ];
        assert_eq!(told, expected);
        assert!(found.iter().all(|one| text[one.range.clone()] == one.original));
        assert_eq!((found[2].line, found[2].column), (3, 29));
    }

    #[test]
    fn text_that_is_no_wgsl_makes_no_panic() {
        for text in
            ["", "fn", "fn f(", "fn f() { ( }", "fn f() { ) * a + ] }", "const a", "@", "if"]
        {
            let _ = mutants(text);
        }
    }
}
