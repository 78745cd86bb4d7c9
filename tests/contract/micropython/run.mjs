// Runs a job of driver.py under MicroPython: node run.mjs FOLDER_OF_SENSOR_NODE JOB_FILE ANSWER_FILE
import { writeFileSync } from 'node:fs';
import { loadPort } from './port.mjs';

const [room, job, answer] = process.argv.slice(2);
const port = await loadPort(room, job);
port.runPython(`
import json, sys
sys.path.append('/')
assert sys.implementation.name == 'micropython'
from tests.contract.micropython.driver import run
with open('/job.json') as file:
    job = json.load(file)
with open('/answer.json', 'w') as file:
    json.dump(run(job), file)
`);
writeFileSync(answer, port.FS.readFile('/answer.json'));
