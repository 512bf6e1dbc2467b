{{/* The name that everything of a release begins with. */}}
{{- define "fleetsight.name" -}}
{{- if contains .Chart.Name .Release.Name }}{{ .Release.Name | trunc 40 | trimSuffix "-" }}
{{- else }}{{ printf "%s-%s" (.Release.Name | trunc 40 | trimSuffix "-") .Chart.Name }}{{ end }}
{{- end }}

{{/* Labels that select the pods of a process. Takes the root and the process's name. */}}
{{- define "fleetsight.selector" -}}
app.kubernetes.io/name: {{ .root.Chart.Name }}
app.kubernetes.io/instance: {{ .root.Release.Name }}
app.kubernetes.io/component: {{ .process }}
{{- end }}

{{- define "fleetsight.labels" -}}
{{ include "fleetsight.selector" . }}
app.kubernetes.io/version: {{ .root.Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ .root.Release.Service }}
helm.sh/chart: {{ .root.Chart.Name }}-{{ .root.Chart.Version }}
{{- end }}

{{- define "fleetsight.metadata" -}}
name: {{ include "fleetsight.name" .root }}-{{ .process }}
labels:
  {{- include "fleetsight.labels" . | nindent 2 }}
{{- end }}

{{/* The certificate of a process: distance and cloud share one. Empty without certificates. */}}
{{- define "fleetsight.certificate" -}}
{{- $tls := .root.Values.tls }}
{{- $owner := has .process (list "distance" "cloud") | ternary "space" .process }}
{{- if $tls.monitor }}
{{- required (printf "tls.%s: with tls.monitor set, name the certificate and secret of %s too" $owner .process) (get $tls $owner) }}
{{- end }}
{{- end }}

{{- define "fleetsight.endpoint" -}}
{{ empty .root.Values.tls.monitor | ternary "tcp" "tls" }}/{{ include "fleetsight.name" .root }}-monitor:7447
{{- end }}

{{/* The settings file of a process: what the chart decides, under what the values say. */}}
{{- define "fleetsight.settings" -}}
{{- $given := index .root.Values .process }}
{{- $certificate := include "fleetsight.certificate" . }}
{{- $settings := dict "shared_memory" false }}
{{- if $certificate }}{{ $_ := set $settings "tls" (printf "/etc/fleetsight/tls/%s" $certificate) }}{{ end }}
{{- if eq .process "monitor" }}
{{- $_ := set $settings "listen" (list (printf "%s/0.0.0.0:7447" (empty $certificate | ternary "tcp" "tls"))) }}
{{- if $certificate }}
{{- $_ := required "tls.access: name the ConfigMap with access.json; a monitor with certificates needs it" .root.Values.tls.access }}
{{- $_ := set $settings "access" "/etc/fleetsight/access/access.json" }}
{{- else }}
{{- if and (or .root.Values.networkPolicy.robots (not .root.Values.networkPolicy.enabled)) (not .root.Values.tls.insecure) }}
{{- fail "tls.monitor: without certificates whoever may connect to port 7447 reads everything and sends as any robot, and networkPolicy lets in more than this release's own pods; name certificates, or set tls.insecure if that is wanted" }}
{{- end }}
{{- $_ := set $settings "insecure" true }}
{{- end }}
{{- $_ := set $settings "web_host" "0.0.0.0" }}
{{- $_ := set $settings "web_open_metrics" $given.openMetrics }}
{{- else }}
{{- $_ := set $settings "connect" (list (include "fleetsight.endpoint" .)) }}
{{- if eq .process "worldmodel" }}{{ $_ := set $settings "state" "/var/lib/fleetsight" }}{{ end }}
{{- end }}
{{- merge (deepCopy $given.settings) $settings | toYaml }}
{{- end }}

{{/* The rules for Prometheus, about this release's series alone where detector.autoscaling.matchers tells them apart. */}}
{{- define "fleetsight.rules" -}}
{{- $rules := .Files.Get "files/rules.yaml" }}
{{- with .Values.detector.autoscaling.matchers }}
{{- $rules = regexReplaceAll "(fleetsight_[a-z_]+)\\{" $rules (printf "${1}{%s, " .) }}
{{- end }}
{{- $rules }}
{{- end }}
