import pickle,collections,math
o=pickle.load(open('/tmp/qs.pkl','rb'))
def q(v,f): v=sorted(v); return v[min(len(v)-1,int(len(v)*f))]
def est(raw,f,bmax=99,hid=.5):
    r=[(d,b) for d,b in raw if abs(b)<=bmax] or raw
    hs=[d for d,b in r if d<0];ks=[d for d,b in r if d>0]
    if len(hs)>=hid*len(r): return None
    if not ks: return None
    return q(ks,f)
methods={'median all':(.5,99,.5),'q.35':(.35,99,.5),'q.25':(.25,99,.5),'q.15':(.15,99,.5),'b<12':(.5,12,.5),'b<8':(.5,8,.5),'hid.3':(.5,99,.3),'hid.15':(.5,99,.15),'q.35 hid.3':(.35,99,.3),'b<12 hid.3':(.5,12,.3)}
print('bins per true distance: near<.9, .9-1.4, 1.4-3')
for n,(f,b,h) in methods.items():
    c=collections.Counter();N=collections.Counter()
    for s in o:
        for r,t in zip(s['rows'],s['td']):
            k=0 if t<.9 else 1 if t<1.4 else 2 if t<3 else 3
            e=est(r[3],f,b,h);N[k]+=1
            if e is None: c[k,'hid']+=1
            elif e>1.25*t: c[k,'gross']+=1
            elif e>1.1*t: c[k,'long']+=1
            elif e<.9*t and min(t,3)*.9>e: c[k,'short']+=1
    print('%-12s'%n,'  |  '.join(' '.join('%s %.3f'%(x,c[k,x]/N[k]) for x in ('hid','gross','long','short')) for k in range(4)))
# concentration of gross per scan
g=[]
for s in o:
    x=sum(1 for r,t in zip(s['rows'],s['td']) if (e:=est(r[3],.5)) is not None and e>1.25*t and t<3)
    g.append(x)
g.sort();print('gross per scan',[g[int(len(g)*f)] for f in (.1,.25,.5,.75,.9,.99)])
