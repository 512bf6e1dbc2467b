// Validates Kubernetes objects of KEDA's and the Prometheus operator's kinds by the schemas of their definitions.
// node custom_kinds.js FOLDER <objects.json: FOLDER has node_modules. Prints a list with what is wrong with each, or "".
const { readFileSync } = require("fs");
const path = require("path");

const PACKAGES = {
  "keda.sh/v1alpha1": "keda/keda.sh/v1alpha1",
  "monitoring.coreos.com/v1": "prometheus-operator/monitoring.coreos.com/v1",
};

function reason(object) {
  const models = require(path.join(process.argv[2], "node_modules/@kubernetes-models", PACKAGES[object.apiVersion]));
  try {
    new models[object.kind](object).validate();
    return "";
  } catch (error) {
    return error.message;
  }
}

console.log(JSON.stringify(JSON.parse(readFileSync(0, "utf8")).map(reason)));
