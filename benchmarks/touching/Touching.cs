// Slides a finger over ribs: Touching.exe COUNT INTERVAL_S. Prints when each batch was sent.
using System;
using System.Collections.Generic;
using System.Globalization;
using System.Threading;
using Haptix;

static class Touching
{
    const string Layout = @"{""regions"": [{""name"": ""ribs"", ""x_mm"": 0, ""y_mm"": 0,
        ""width_mm"": 100, ""height_mm"": 60,
        ""material"": {""kind"": ""grating"", ""period_mm"": 2.0, ""low"": 0.6, ""high"": 0.9}}]}";

    static void Main(string[] arguments)
    {
        int count = int.Parse(arguments[0]);
        double intervalS = double.Parse(arguments[1], CultureInfo.InvariantCulture);
        var random = new Random(1);
        var sentS = new List<string>();
        using (Session h = Session.Connect("C#").Result)
        {
            h.LayoutSet(Newtonsoft.Json.JsonConvert.DeserializeObject<Haptix.Messages.LayoutDocument>(Layout)).Wait();
            h.Acquire().Wait();
            h.Arm().Wait();
            Thread.Sleep(1000);
            for (int i = 0; i < count; i++)
            {
                sentS.Add(Session.NowS.ToString("R", CultureInfo.InvariantCulture)); // CLOCK_MONOTONIC
                h.Touch((float)(50 + 30 * Math.Sin(i / 50.0)), 30f, 0.5f);
                Thread.Sleep(TimeSpan.FromSeconds(intervalS * (0.5 + random.NextDouble())));
            }
            Thread.Sleep(300);
        }
        Console.WriteLine("[" + string.Join(",", sentS) + "]");
    }
}
