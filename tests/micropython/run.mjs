// Runs a job of driver.py under MicroPython: node run.mjs FOLDER_OF_SENSOR_NODE JOB_FILE ANSWER_FILE
import { loadMicroPython } from '@micropython/micropython-webassembly-pyscript/micropython.mjs';
import { readdirSync, readFileSync, writeFileSync } from 'node:fs';
import { fileURLToPath } from 'node:url';

const [room, job, answer] = process.argv.slice(2);
const port = await loadMicroPython({ stdout: console.error, linebuffer: true });
// Nothing but the firmware: what it must not import is not there.
port.FS.mkdir('/sensor_node');
port.FS.mkdir('/sensor_node/firmware');
port.FS.writeFile('/sensor_node/__init__.py', '');
for (const name of readdirSync(`${room}/firmware`).filter((name) => name.endsWith('.py'))) {
  port.FS.writeFile(`/sensor_node/firmware/${name}`, readFileSync(`${room}/firmware/${name}`));
}
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
