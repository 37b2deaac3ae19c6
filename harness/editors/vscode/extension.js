// Starts `karat lsp`, and shows the review in a panel. What is found is the server's: docs/editors.md.
"use strict";

const { spawn } = require("node:child_process");
const fs = require("node:fs");
const path = require("node:path");
const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

/** @type {LanguageClient | undefined} */
let client;

/** The last start or stop of the server: the next one waits for it. */
let turn = Promise.resolve();

/** The open review, and the process that serves it. */
let shown;

/** The folder that a command is about: that of the text in front or, without one, the first that is open. */
function folder() {
  const text = vscode.window.activeTextEditor?.document.uri;
  return (text && vscode.workspace.getWorkspaceFolder(text)) ?? vscode.workspace.workspaceFolders?.[0];
}

/** The program: what the settings say, what npm installed in the folder, or what PATH has. */
function program() {
  const set = vscode.workspace.getConfiguration("karat").get("command");
  if (set) return set;
  const root = folder()?.uri.fsPath;
  // Not npm's command, which is a script of a shell on Windows: the program itself.
  const own = `karat-${process.platform}-${process.arch}`;
  const file = process.platform === "win32" ? "karat.exe" : "karat";
  const installed = root && path.join(root, "node_modules", own, "bin", file);
  return installed && fs.existsSync(installed) ? installed : "karat";
}

/** An error, with a way to the setting that mends it. Nothing waits for the answer. */
function say(message) {
  const settings = "Open Settings";
  vscode.window.showErrorMessage(message, settings).then((answer) => {
    if (answer === settings) vscode.commands.executeCommand("workbench.action.openSettings", "karat.command");
  });
}

async function start() {
  const paths = vscode.workspace.getConfiguration("karat").get("paths");
  const named = Array.isArray(paths) && paths.length > 0 ? ["--paths", paths.join(",")] : [];
  const run = { command: program(), args: ["lsp", ...named], options: { cwd: folder()?.uri.fsPath } };
  const documentSelector = ["wgsl", "wesl"].map((language) => ({ scheme: "file", language }));
  client = new LanguageClient("karat", "Karat", run, { documentSelector });
  try {
    await client.start();
  } catch (error) {
    say(`\`${run.command} lsp\` doesn't start: ${error.message ?? error}`);
  }
}

async function stop() {
  const last = client;
  client = undefined;
  // One that never started can't be stopped, and needn't be.
  await last?.dispose().catch(() => {});
}

function restart() {
  turn = turn.then(stop).then(start);
  return turn;
}

/** `karat test` in a terminal: its colours, links and progress are made for one. The server hears when it ends. */
async function test() {
  const own = folder();
  const execution = new vscode.ProcessExecution(program(), ["test"], { cwd: own?.uri.fsPath });
  const scope = own ?? vscode.TaskScope.Workspace;
  await vscode.tasks.executeTask(new vscode.Task({ type: "karat" }, scope, "test", "karat", execution));
}

/** `karat review` in a panel, for as long as that is open. */
function review() {
  if (shown) return shown.panel?.reveal();
  const server = spawn(program(), ["review", "--in-editor"], { cwd: folder()?.uri.fsPath });
  const own = (shown = { server });
  let out = "";
  let err = "";
  server.stdin.end();
  server.on("error", (error) => (err = `it doesn't start: ${error.message}`));
  server.stderr.on("data", (data) => (err += data));
  server.stdout.on("data", async (data) => {
    if (own.panel) return;
    out += data;
    const url = out.match(/^http:\/\/127\.0\.0\.1:\d+\/\w+\/$/m)?.[0];
    if (!url) return;
    own.panel = vscode.window.createWebviewPanel("karat.review", "Karat: Review", vscode.ViewColumn.Active, {
      enableScripts: true, // those of the review: a frame may do no more than what is around it
      retainContextWhenHidden: true,
    });
    own.panel.onDidDispose(() => server.kill());
    own.panel.webview.html = page(url);
  });
  server.on("close", (code, signal) => {
    if (shown === own) shown = undefined;
    if (own.panel) return own.panel.dispose();
    // Without a page it has said why: that nothing is pending, or what is wrong.
    const said = (err.trim() || out.trim() || `it ended with ${signal ?? code}`).split("\n")[0];
    if (code === 0) vscode.window.showInformationMessage(`Karat: ${said}`);
    else say(`\`karat review\`: ${said}`);
  });
}

/** A page that holds another one, and may hold nothing else. */
function page(url) {
  const policy = `default-src 'none'; style-src 'unsafe-inline'; frame-src ${new URL(url).origin}`;
  return `<!DOCTYPE html>
<meta http-equiv="Content-Security-Policy" content="${policy}">
<title>Karat: Review</title>
<style>html, body, iframe { margin: 0; padding: 0; border: 0; width: 100%; height: 100%; display: block; }</style>
<iframe src="${url}" title="Frames that differ, beside their goldens" allow="clipboard-write"></iframe>`;
}

exports.activate = (context) => {
  const commands = { "karat.test": test, "karat.review": review, "karat.restart": restart };
  for (const [name, run] of Object.entries(commands)) {
    context.subscriptions.push(vscode.commands.registerCommand(name, run));
  }
  const changed = (event) => event.affectsConfiguration("karat") && restart();
  context.subscriptions.push(vscode.workspace.onDidChangeConfiguration(changed));
  turn = start();
};

exports.deactivate = () => {
  shown?.server.kill();
  return turn.then(stop);
};
