// Runs a job of driver.py under MicroPython: node run.mjs FOLDER_OF_SENSOR_NODE JOB_FILE ANSWER_FILE
import { loadMicroPython } from '@micropython/micropython-webassembly-pyscript/micropython.mjs';
import { readdirSync, readFileSync, writeFileSync } from 'node:fs';
import { fileURLToPath } from 'node:url';

const [room, job, answer] = process.argv.slice(2);
const port = await loadMicroPython({ stdout: console.error, linebuffer: true });
// Nothing but the firmware: what it must not import is not there.
function copy(folder) {
  port.FS.mkdir(`/sensor_node/${folder}`);
  for (const entry of readdirSync(`${room}/${folder}`, { withFileTypes: true })) {
    const name = `${folder}/${entry.name}`;
    if (entry.isDirectory()) copy(name);
    else if (name.endsWith('.py')) port.FS.writeFile(`/sensor_node/${name}`, readFileSync(`${room}/${name}`));
  }
}
port.FS.mkdir('/sensor_node');
port.FS.writeFile('/sensor_node/__init__.py', '');
copy('firmware');
const own = fileURLToPath(new URL('.', import.meta.url));
port.FS.mkdir('/tests');
port.FS.mkdir('/tests/micropython');
for (const name of readdirSync(own).filter((name) => name.endsWith('.py'))) {
  port.FS.writeFile(`/tests/micropython/${name}`, readFileSync(`${own}/${name}`));
}
port.FS.writeFile('/job.json', readFileSync(job));
port.runPython(`
import json, sys
sys.path.append('/')
assert sys.implementation.name == 'micropython'
from tests.micropython.driver import run
with open('/job.json') as file:
    job = json.load(file)
with open('/answer.json', 'w') as file:
    json.dump(run(job), file)
`);
writeFileSync(answer, port.FS.readFile('/answer.json'));
