// The contract of all clients, clients/contract.jsonl: each call by its name, in C# style.
using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Reflection;
using System.Threading;
using System.Threading.Tasks;
using Haptix;
using Newtonsoft.Json.Linq;

static class Contract
{
    public static async Task Play(string path)
    {
        Session h = await Session.Connect("contract");
        var heard = new List<KeyValuePair<string, JObject>>();
        h.On<Haptix.Messages.Contact>(each => heard.Add(Heard("contact", each)));
        h.On<Haptix.Messages.Error>(each => heard.Add(Heard("error", each)));
        h.On<Frame>(each => heard.Add(Heard("frame", each)));
        var regions = new Dictionary<string, Region>();
        foreach (JObject line in File.ReadAllLines(path).Select(JObject.Parse))
        {
            heard.Clear();
            object answer = null;
            try { answer = await Call(h, regions, line); }
            catch (Refused refused)
            {
                if (line["refuses"] == null) throw;
                Check.That((string)line["refuses"]["code"] == refused.Code, line + " but " + refused.Code);
                Check.That((string)line["refuses"]["path"] == refused.Path, line + " but " + refused.Path);
                continue;
            }
            catch (Lost lost)
            {
                Check.That((string)line["fails"] == lost.Message, line + " but " + lost.Message);
                continue;
            }
            Check.That(line["refuses"] == null && line["fails"] == null, line + " fails");
            if (line["answers"] != null) Check.That(Fits(line["answers"], JObject.FromObject(answer)), line + " but " + answer);
            if (line["names"] != null) Check.That((string)line["names"] == (string)answer, line + " but " + answer);
            if (line["as"] != null) regions[((Region)answer).Name] = (Region)answer;
            if (line["hears"] == null) continue;
            foreach (JProperty one in ((JObject)line["hears"]).Properties())
            {
                int looks = 0;
                for (; !heard.Any(each => each.Key == one.Name && Fits(one.Value, each.Value)); h.Pump(), looks++)
                {
                    Check.That(looks < Check.Patience, one.ToString());
                    Thread.Sleep(10);
                }
            }
        }
    }

    static KeyValuePair<string, JObject> Heard(string kind, object each)
    {
        return new KeyValuePair<string, JObject>(kind, JObject.FromObject(each));
    }

    static bool Fits(JToken expected, JObject got)
    {
        return ((JObject)expected).Properties().All(each => {
            JToken value = got[each.Name];
            bool isNumber = value is JValue && (value.Type == JTokenType.Float || value.Type == JTokenType.Integer);
            return isNumber ? (double)value == (double)each.Value : JToken.DeepEquals(value, each.Value);
        });
    }

    static async Task<object> Call(Session h, Dictionary<string, Region> regions, JObject line)
    {
        string name = (string)line["do"];
        var fields = (JObject)line["with"] ?? new JObject();
        if (name == "close")
        {
            h.Dispose();
            return null;
        }
        if (name == "asset")
        {
            string path = Path.Combine(Path.GetTempPath(), Path.GetRandomFileName() + Path.GetExtension((string)fields["name"]));
            File.WriteAllText(path, (string)fields["text"]);
            try { return await h.Asset(path); }
            finally { File.Delete(path); }
        }
        object target = line["of"] != null ? regions[(string)line["of"]] : name.StartsWith("layout.") ? (object)h.Layout : h;
        MethodInfo method = target.GetType().GetMethod(Pascal(name.Split('.').Last()));
        object[] arguments = method.GetParameters().Select(each => Argument(each, fields)).ToArray();
        object found = method.Invoke(target, arguments);
        var task = found as Task;
        if (task == null) return found;
        await task;
        return task.GetType().GetProperty("Result").GetValue(task, null);
    }

    static object Argument(ParameterInfo parameter, JObject fields)
    {
        JProperty given = fields.Properties().SingleOrDefault(each => Pascal(each.Name) == Pascal(parameter.Name));
        if (given == null) return parameter.DefaultValue;
        if (parameter.ParameterType == typeof(Material)) return Material.Parse(given.Value.ToString());
        return given.Value.ToObject(parameter.ParameterType);
    }

    static string Pascal(string name)
    {
        return string.Concat(name.Split('_').Select(part => char.ToUpper(part[0]) + part.Substring(1)));
    }
}
