//! Text to operations.

use std::fmt;

/// Number of the input with a name and what stands in brackets, or why there is none.
type Named<'n> = dyn FnMut(&str, Option<&str>) -> Result<usize, String> + 'n;

use crate::numerics::formula::graph::{Func, Graph, Id, Pair};
use crate::text::{character, quoted};

/// Longest formula, in characters.
const LONGEST: usize = 8000;

/// Deepest nesting of a formula.
const DEEPEST: usize = 60;

/// A formula that cannot be read, with the place in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Misread {
    /// The character, counted from 1; one more than there are at the end of the text.
    pub at: usize,
    /// What stands there.
    pub found: String,
    /// What could stand there.
    pub expected: String,
}

impl fmt::Display for Misread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "character {}: {}", self.at, self.found)
    }
}

/// Reads a formula into `graph`.
///
/// `input` gives the number of the input that a name means, with what stands in brackets where
/// there are any: `theta[2]`, `theta[elbow]`. Where there is no such input, it says what there is.
///
/// # Errors
///
/// [`Misread`] with the place.
pub fn parse(text: &str, graph: &mut Graph, input: &mut Named<'_>) -> Result<Id, Misread> {
    let characters: Vec<char> = text.chars().collect();
    let mut parser = Parser { characters, at: 0, depth: 0, graph, input };
    if parser.characters.len() > LONGEST {
        let found = format!("{} characters", parser.characters.len());
        return Err(Misread { at: LONGEST, found, expected: format!("at most {LONGEST}") });
    }
    let whole = parser.sum()?;
    match parser.peek() {
        None => Ok(whole),
        Some(_) => Err(parser.misread("an operator, or the end of the formula")),
    }
}

struct Parser<'a> {
    characters: Vec<char>,
    at: usize,
    depth: usize,
    graph: &'a mut Graph,
    input: &'a mut Named<'a>,
}

impl Parser<'_> {
    /// The next character that is no space.
    fn peek(&mut self) -> Option<char> {
        while self.characters.get(self.at).is_some_and(|c| c.is_whitespace()) {
            self.at += 1;
        }
        self.characters.get(self.at).copied()
    }

    /// Takes the next character where it is this one.
    fn take(&mut self, wanted: char) -> bool {
        let there = self.peek() == Some(wanted);
        self.at += usize::from(there);
        there
    }

    fn misread(&mut self, expected: &str) -> Misread {
        let found = match self.peek() {
            None => "the end of the formula".into(),
            Some(c) => character(c),
        };
        Misread { at: self.at + 1, found, expected: expected.into() }
    }

    fn sum(&mut self) -> Result<Id, Misread> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self.misread(&format!("at most {DEEPEST} levels of nesting")));
        }
        let mut sum = self.product()?;
        loop {
            let pair = match self.peek() {
                Some('+') => Pair::Add,
                Some('-') => Pair::Sub,
                _ => break,
            };
            self.at += 1;
            let next = self.product()?;
            sum = self.graph.pair(pair, sum, next);
        }
        self.depth -= 1;
        Ok(sum)
    }

    fn product(&mut self) -> Result<Id, Misread> {
        let mut product = self.sign()?;
        loop {
            let pair = match self.peek() {
                Some('*') => Pair::Mul,
                Some('/') => Pair::Div,
                _ => return Ok(product),
            };
            self.at += 1;
            let next = self.sign()?;
            product = self.graph.pair(pair, product, next);
        }
    }

    fn sign(&mut self) -> Result<Id, Misread> {
        let mut negative = false;
        while let Some(sign @ ('+' | '-')) = self.peek() {
            negative ^= sign == '-';
            self.at += 1;
        }
        let power = self.power()?;
        Ok(if negative { self.graph.negative(power) } else { power })
    }

    fn power(&mut self) -> Result<Id, Misread> {
        let base = self.atom()?;
        let twice = self.peek() == Some('*') && self.characters.get(self.at + 1) == Some(&'*');
        if twice {
            self.at += 1;
        }
        if !twice && self.peek() != Some('^') {
            return Ok(base);
        }
        self.at += 1;
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self.misread(&format!("at most {DEEPEST} levels of nesting")));
        }
        let exponent = self.sign()?;
        self.depth -= 1;
        Ok(self.graph.power(base, exponent))
    }

    fn atom(&mut self) -> Result<Id, Misread> {
        match self.peek() {
            Some('(') => {
                self.at += 1;
                let inner = self.sum()?;
                self.close(')')?;
                Ok(inner)
            }
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_alphabetic() || c == '_' => self.name(),
            _ => Err(self.misread("a number, a name or a parenthesis")),
        }
    }

    fn close(&mut self, bracket: char) -> Result<(), Misread> {
        if self.take(bracket) { Ok(()) } else { Err(self.misread(&character(bracket))) }
    }

    /// The characters from here on that are all of a kind.
    fn run(&mut self, of: impl Fn(char) -> bool) -> String {
        let rest = &self.characters[self.at..];
        let run: String = rest.iter().copied().take_while(|c| of(*c)).collect();
        self.at += run.chars().count();
        run
    }

    fn number(&mut self) -> Result<Id, Misread> {
        let start = self.at;
        let mut text = self.run(|c| c.is_ascii_digit() || c == '.');
        let next = |k: usize| self.characters.get(self.at + k).copied();
        let signed = usize::from(matches!(next(1), Some('+' | '-')));
        let exponent = next(1 + signed).is_some_and(|c| c.is_ascii_digit());
        if matches!(next(0), Some('e' | 'E')) && exponent {
            text.extend(&self.characters[self.at..=self.at + signed]);
            self.at += 1 + signed;
            text += &self.run(|c| c.is_ascii_digit());
        }
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(self.graph.constant(value)),
            _ => Err(Misread { at: start + 1, found: quoted(&text), expected: "a number".into() }),
        }
    }

    fn name(&mut self) -> Result<Id, Misread> {
        let start = self.at;
        let name = self.run(|c| c.is_alphanumeric() || c == '_');
        if self.peek() == Some('(') {
            return self.call(start, &name);
        }
        if name == "pi" {
            return Ok(self.graph.constant(std::f64::consts::PI));
        }
        let index = match self.take('[') {
            false => None,
            true => {
                self.peek();
                let inside = self.run(|c| !matches!(c, '[' | ']'));
                let inside = inside.trim_end().to_string();
                if inside.is_empty() {
                    return Err(self.misread("a whole number, or a name"));
                }
                self.close(']')?;
                Some(inside)
            }
        };
        let found = || match &index {
            Some(index) => format!("{name}[{index}]"),
            None => name.clone(),
        };
        let input = (self.input)(&name, index.as_deref());
        let input = input.map_err(|expected| Misread {
            at: start + 1,
            found: quoted(&found()),
            expected,
        })?;
        Ok(self.graph.input(input))
    }

    fn call(&mut self, start: usize, name: &str) -> Result<Id, Misread> {
        self.close('(')?;
        let first = self.sum()?;
        if let Some(function) = Func::named(name) {
            self.close(')')?;
            return Ok(self.graph.apply(function, first));
        }
        let Some(pair) = Pair::named(name) else {
            let found = format!("function {}", quoted(name));
            return Err(Misread { at: start + 1, found, expected: functions() });
        };
        self.close(',')?;
        let second = self.sum()?;
        self.close(')')?;
        Ok(self.graph.pair(pair, first, second))
    }
}

/// Names of all functions.
fn functions() -> String {
    let one = Func::NAMES.iter().map(|(name, _)| *name);
    one.chain(Pair::NAMES.iter().map(|(name, _)| *name)).collect::<Vec<_>>().join(", ")
}
