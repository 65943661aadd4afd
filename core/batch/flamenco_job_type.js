// SPDX-License-Identifier: GPL-3.0-or-later
//
// A job type for Flamenco 3.3 and later, whose workers have the command "exec": each task of a batch of turntables
// (scripts/turntable.py) as a task of the farm. Put this file into the folder "scripts" next to flamenco-manager. Jobs
// are not submitted from Blender but written by `turntable.py BATCH.toml --out DIR --export flamenco`; docs/batches.md
// says how to submit one.

const JOB_TYPE = {
    label: "cvdgs turntables",
    description: "Turntables of CVD-friendly Gaussian scenes",
    settings: [
        { key: "plan", type: "string", subtype: "file_path", required: true,
          description: "The batch's plan, in the folder that all machines share" },
        { key: "python", type: "string", required: true,
          description: "Python 3.11 or later on the workers, or a variable of the Manager that says which" },
        { key: "script", type: "string", subtype: "file_path", required: true,
          description: "scripts/turntable.py of cvdgs on the workers" },
        { key: "render_task_type", type: "string", default: "blender",
          description: "Type of the tasks that train, render and encode" },
        { key: "gpu_task_type", type: "string", default: "blender",
          description: "Type of the tasks that need a graphics card; give it to the workers that have one" },
        { key: "page_task_type", type: "string", default: "misc",
          description: "Type of the tasks that make contact sheets and the page, which are short" },
        { key: "tasks", type: "string", required: true, visible: "hidden",
          description: "JSON: a list of {name, kind, gpu, after}, each after those that it waits for" },
    ]
};

const SHORT_KINDS = new Set(["sheet", "page"]);

function compileJob(job) {
    const settings = job.settings;
    const authored = new Map();
    for (const task of JSON.parse(settings.tasks)) {
        authored.set(task.name, authorTask(task, settings, authored));
    }
    // Flamenco takes a copy of a task here, so it has to be whole.
    for (const task of authored.values()) {
        job.addTask(task);
    }
}

function authorTask(task, settings, earlier) {
    const authored = author.Task(task.name, taskType(task, settings));
    authored.addCommand(author.Command("exec", {
        exe: settings.python,
        args: [settings.script, "--plan", settings.plan, "--task", task.name, "--json"],
    }));
    for (const name of task.after) {
        if (!earlier.has(name)) {
            throw `task "${task.name}" comes before "${name}", which it waits for`;
        }
        authored.addDependency(earlier.get(name));
    }
    return authored;
}

function taskType(task, settings) {
    if (task.gpu > 0) {
        return settings.gpu_task_type || "blender";
    }
    if (SHORT_KINDS.has(task.kind)) {
        return settings.page_task_type || "misc";
    }
    return settings.render_task_type || "blender";
}
