// Compiles a job as Flamenco's Manager does: the job type runs in strict mode, in a context of its own that has what
// the Manager offers to job types and nothing of Node; tasks are copied when they are added to the job; defaults of
// settings are the submitter's business and not filled in.
//
//     node flamenco_manager.js JOB_TYPE.js JOB.json      writes the job type's description and the tasks as JSON
//
// Written after Flamenco's sources (projects.blender.org/studio/flamenco): internal/manager/job_compilers/author.go,
// scripts.go and job_compilers.go. The version of late 2023 and later ones differ in the step count alone.

const fs = require("fs");
const vm = require("vm");

const [typeFile, jobFile] = process.argv.slice(2);

class Task {
    constructor(name, type) {
        name = name.trim();
        type = type.trim();
        if (!name || !type) {
            throw new Error("author.Task(name, type): both are required");
        }
        Object.assign(this, { name, type, priority: 50, commands: [], dependencies: [] });
    }
    addCommand(command) {
        this.commands.push(command);
    }
    addDependency(task) {
        this.dependencies.push(task);
    }
}

const job = {
    ...JSON.parse(fs.readFileSync(jobFile, "utf-8")),
    tasks: [],
    addTask(task) {
        const dependencies = task.dependencies.map((earlier) => earlier.name);
        this.tasks.push({ name: task.name, type: task.type, commands: [...task.commands], dependencies });
    },
};
const context = vm.createContext({
    author: {
        Task: (name, type) => new Task(name, type),
        Command: (name, parameters, totalStepCount = 0) => ({ name, parameters, totalStepCount }),
    },
    print: () => {},
    job,
});
vm.runInContext('"use strict";' + fs.readFileSync(typeFile, "utf-8"), context);
vm.runInContext("compileJob(job)", context);
const type = vm.runInContext("JOB_TYPE", context);
console.log(JSON.stringify({ type, tasks: job.tasks }));
